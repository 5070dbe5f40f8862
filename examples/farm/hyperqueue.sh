#!/bin/sh
# HyperQueue: a server and a worker on this machine run a plan (pip install hyperqueue). The wheel brings both, but no `hq`; with
# that, and a server and workers running, `hq job submit-file plan.hq.toml` is all.
. "$(dirname "$0")/prepare.sh"
prepare hq "$@"
python3 "$here/hyperqueue_submit.py" "$WORK/plan.hq.toml"
compare HyperQueue
