#!/bin/sh
# Slurm: one node on loopback runs a plan through sbatch. Root of a Debian or Ubuntu machine; installs slurm-wlm and munge where they
# are missing. Its daemons have their own configuration, key and sockets in a folder of ours and end with this script: a Slurm that
# the machine may have is left alone.
. "$(dirname "$0")/prepare.sh"
export PATH="$PATH:/usr/sbin"
[ "$(id -u)" = 0 ] || { echo "slurm.sh has to be root: it starts Slurm's daemons" >&2; exit 1; }
if ! command -v slurmctld >/dev/null || ! command -v slurmd >/dev/null || ! command -v munged >/dev/null; then
	apt-get update -qq
	DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends slurm-wlm munge >/dev/null
fi
prepare slurm "$@"

slurm=$(mktemp -d /tmp/relight-slurm.XXXXXX)
stop() {
	for daemon in slurmd slurmctld munged; do
		[ ! -s "$slurm/$daemon.pid" ] || kill "$(cat "$slurm/$daemon.pid")" 2>/dev/null || true
	done
	sleep 1
	[ "$1" = 0 ] || tail -n 20 "$slurm"/*.log >&2 || true
	rm -rf "$slurm"
}
chmod 755 "$slurm"
mkdir -m 700 "$slurm/munge"
mkdir "$slurm/state" "$slurm/spool"
dd if=/dev/urandom of="$slurm/munge/key" bs=128 count=1 2>/dev/null
chmod 600 "$slurm/munge/key"
munged --force --socket="$slurm/munge.socket" --key-file="$slurm/munge/key" --pid-file="$slurm/munged.pid" \
	--log-file="$slurm/munge/munged.log" --seed-file="$slurm/munge/seed"

# What this machine has: NodeName=.. CPUs=.. RealMemory=..
node=$(slurmd -C | head -n 1)
name=$(printf '%s\n' "$node" | sed 's/NodeName=\([^ ]*\).*/\1/')
cat >"$slurm/slurm.conf" <<END
ClusterName=relight
SlurmctldHost=$name(127.0.0.1)
SlurmctldPort=26817
SlurmdPort=26818
SlurmUser=root
AuthType=auth/munge
AuthInfo=socket=$slurm/munge.socket
CredType=cred/munge
MpiDefault=none
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
SchedulerType=sched/backfill
ReturnToService=2
StateSaveLocation=$slurm/state
SlurmdSpoolDir=$slurm/spool
SlurmctldPidFile=$slurm/slurmctld.pid
SlurmdPidFile=$slurm/slurmd.pid
SlurmctldLogFile=$slurm/slurmctld.log
SlurmdLogFile=$slurm/slurmd.log
$node NodeAddr=127.0.0.1 State=UNKNOWN
PartitionName=all Nodes=$name Default=YES MaxTime=INFINITE State=UP
END
export SLURM_CONF="$slurm/slurm.conf"
slurmctld
slurmd
waited=0
until sinfo --noheader --format=%t 2>/dev/null | grep -q '^idle'; do
	waited=$((waited + 1))
	[ "$waited" -lt 60 ] || { echo "slurm.sh: the node does not come up" >&2; sinfo >&2; exit 1; }
	sleep 1
done
sbatch --version

cd "$WORK"
sh plan.slurm.sh | tee jobs
merge=$(tail -n 1 jobs)
# No accounting here: a job that is done leaves the queue, and the controller still knows it for a while.
waited=0
until [ -z "$(squeue --noheader --jobs="$merge" --states=PENDING,RUNNING,COMPLETING 2>/dev/null)" ]; do
	waited=$((waited + 1))
	[ "$waited" -lt "${LIMIT:-280}" ] || { squeue >&2; echo "slurm.sh: not done after ${LIMIT:-280} s" >&2; exit 1; }
	sleep 1
done
scontrol show job "$merge" | grep JobState
cat slurm-*.out
# A task that is sent again is the shard that it was, though Slurm's array begins with it now.
sbatch --wait --array="$SHARDS" --output=again.out --wrap 'relight bake --plan plan.json --shard auto -o again.parts'
grep "^shard $SHARDS/$SHARDS: " again.out || { cat again.out >&2; exit 1; }
compare Slurm
