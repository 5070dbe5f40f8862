#!/bin/sh
# Kubernetes: the manifest is held to the schema of its interface (pip install kubernetes-validate); nothing runs it here.
# What each pod of the indexed job would run is run by hand, with the variable that Kubernetes sets.
. "$(dirname "$0")/prepare.sh"
prepare k8s "$@"
kubernetes-validate --strict "$WORK/plan.k8s.yaml"
# A validator that finds nothing wrong with anything shows nothing.
sed 's/"completions": [0-9]*/"completions": "many"/' "$WORK/plan.k8s.yaml" >"$WORK/wrong.yaml"
if kubernetes-validate --strict --quiet "$WORK/wrong.yaml" >/dev/null 2>&1; then
	echo "kubernetes-validate takes completions: many for valid" >&2
	exit 1
fi
index=0
while [ "$index" -lt "$SHARDS" ]; do
	JOB_COMPLETION_INDEX=$index relight bake --plan "$WORK/plan.json" --shard auto -o "$WORK/plan.parts"
	index=$((index + 1))
done
relight merge --plan "$WORK/plan.json" "$WORK/plan.parts" -o "$WORK/merged.ktx2"
compare "Kubernetes (by hand)"
