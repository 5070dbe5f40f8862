#!/bin/sh
# Runs examples/farm for the engines that are installed, and says which are not.
#   tests/recipes/farm.sh        relight and python3 from PATH; Slurm too with RELIGHT_SLURM=1 as root, which installs it
set -u
farm=$(cd "$(dirname "$0")/../../examples/farm" && pwd)
log=$(mktemp)
trap 'rm -f "$log"' EXIT
failed=0

engine() { # script, how long it may take in s, the test of whether it is there
	script=$1
	limit=$2
	shift 2
	if ! "$@" >/dev/null 2>&1; then
		echo "recipes: $script is skipped: no $*"
	elif timeout "$limit" "$farm/$script" >"$log" 2>&1; then
		echo "recipes: $(tail -n 1 "$log")"
	else
		echo "recipes: $script ended with $?:"
		tail -n 40 "$log"
		failed=1
	fi
}
engine hyperqueue.sh 300 python3 -c 'import hyperqueue, tomllib'
engine openjd.sh 300 openjd --version
engine kubernetes.sh 300 kubernetes-validate --version
engine slurm.sh 600 test "${RELIGHT_SLURM:-}" = 1
exit "$failed"
