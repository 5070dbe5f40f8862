# Sourced by the scripts beside it: `prepare ENGINE "$@"` bakes a capture in one process and plans the same bake over shards,
# `compare ENGINE` says whether the merged asset has the same bytes, and fails where not.
#
# Arguments of every script: [CAPTURE [option of relight bake]..]. Variables: WORK, a folder for what is made (a temporary one
# unless given); SHARDS, 4 unless given.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
SHARDS=${SHARDS:-4}
ours=
command -v relight >/dev/null || { echo "relight is not in PATH" >&2; exit 1; }

# What an engine has to end; scripts have their own.
stop() { :; }
trap 'status=$?; stop "$status"; [ -z "$ours" ] || rm -rf "$ours"; exit "$status"' EXIT
trap 'exit 130' INT TERM

prepare() {
	engine=$1
	shift
	capture=${1:-$here/../../testdata/icon72}
	[ $# -eq 0 ] || shift
	# Planes learned from all pixels: shards have to agree about them before any of them fits.
	[ $# -gt 0 ] || set -- --basis pca -k 9 --mips
	[ -n "${WORK:-}" ] || { ours=$(mktemp -d); WORK=$ours; }
	mkdir -p "$WORK"
	WORK=$(cd "$WORK" && pwd)
	rm -rf "$WORK/plan.parts" "$WORK/merged.ktx2"
	relight bake "$capture" -o "$WORK/single.ktx2" "$@"
	# Machines of a farm know no PATH of ours.
	relight plan "$capture" --asset "$WORK/merged.ktx2" "$@" --shards "$SHARDS" -o "$WORK/plan.json" \
		--format "$engine" --program "$(command -v relight)"
}

compare() {
	cmp "$WORK/single.ktx2" "$WORK/merged.ktx2"
	echo "$1: $SHARDS shards, merged: the bytes of the single bake"
}
