#!/bin/sh
# Open Job Description: the template's steps run in a local session (pip install openjd-cli).
. "$(dirname "$0")/prepare.sh"
prepare openjd "$@"
openjd check "$WORK/plan.openjd.json"
# Merge depends on Shards.
openjd run "$WORK/plan.openjd.json" --step Merge --run-dependencies
compare "Open Job Description"
