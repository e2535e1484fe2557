#!/usr/bin/env bash
# A Slurm cluster of several nodes on one machine, for tests: test-cluster.sh up DIR [NODES] | down DIR
#
# Debian packages slurmctld, slurmd, slurm-client and munge. All daemons run as the present user, listen on 127.0.0.1 and keep their files in
# DIR. `. DIR/env` lets the commands of Slurm find the cluster. Not for real work: nothing limits what a job takes.
set -euo pipefail

usage() { echo "usage: $0 up DIR [NODES] | down DIR" >&2; exit 64; }
[ $# -ge 2 ] || usage
# Debian keeps daemons where not every user looks.
PATH="$PATH:/usr/sbin"
action="$1" nodes="${3:-3}"
mkdir -p "$2"
dir="$(cd "$2" && pwd)"

free_port() { python3 -c 'import socket; s = socket.socket(); s.bind(("127.0.0.1", 0)); print(s.getsockname()[1])'; }

up() {
    local host user i cpus
    host="$(hostname -s)" user="$(id -un)" cpus=4
    mkdir -p "$dir/log" "$dir/state" "$dir/run"
    chmod 700 "$dir/run"
    (umask 077 && head -c 1024 /dev/urandom >"$dir/munge.key")
    munged --force --key-file="$dir/munge.key" --socket="$dir/run/munge" --pid-file="$dir/run/munged.pid" \
        --log-file="$dir/log/munged.log" --seed-file="$dir/run/munge.seed"
    {
        cat <<CONF
ClusterName=test
SlurmctldHost=$host(127.0.0.1)
SlurmctldPort=$(free_port)
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
AuthInfo=socket=$dir/run/munge,cred_expire=5
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
StateSaveLocation=$dir/state
SlurmctldPidFile=$dir/run/slurmctld.pid
SlurmctldLogFile=$dir/log/slurmctld.log
SlurmdPidFile=$dir/run/slurmd.%n.pid
SlurmdLogFile=$dir/log/slurmd.%n.log
SlurmdSpoolDir=$dir/spool.%n
ProctrackType=proctrack/pgid
TaskPlugin=task/none
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SlurmdParameters=config_overrides
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=sched_min_interval=100000,batch_sched_delay=0
MpiDefault=none
SwitchType=switch/none
JobRequeue=1
ReturnToService=2
SlurmdTimeout=10
MinJobAge=300
KillWait=5
MaxArraySize=10001
CONF
        for ((i = 1; i <= nodes; i++)); do
            echo "NodeName=n$i NodeHostname=$host NodeAddr=127.0.0.1 Port=$(free_port) CPUs=$cpus State=UNKNOWN"
        done
        echo "PartitionName=test Nodes=ALL Default=YES MaxTime=INFINITE State=UP"
    } >"$dir/slurm.conf"
    echo "export SLURM_CONF='$dir/slurm.conf'" >"$dir/env"
    # shellcheck source=/dev/null
    . "$dir/env"
    slurmctld
    for ((i = 1; i <= nodes; i++)); do
        mkdir -p "$dir/spool.n$i"
        slurmd -N "n$i"
    done
    for ((i = 0; i < 100; i++)); do
        [ "$(sinfo -h -t idle -o %D 2>/dev/null | tail -1)" = "$nodes" ] && return
        sleep 0.1
    done
    sinfo >&2 || true
    tail -n 5 -q "$dir"/log/*.log >&2
    echo "ERROR: $nodes idle nodes expected within 10 s" >&2
    down
    exit 75
}

# Ends only what `up` began: the processes whose numbers their own files name.
down() {
    local file i
    if [ -f "$dir/env" ]; then
        # shellcheck source=/dev/null
        . "$dir/env"
        timeout 10 scancel --signal=KILL --full --user="$(id -un)" 2>/dev/null || true
    fi
    local pid pids=()
    for file in "$dir"/run/slurmd.*.pid "$dir/run/slurmctld.pid" "$dir/run/munged.pid"; do
        if [ -s "$file" ]; then pids+=("$(cat "$file")"); fi
    done
    for pid in "${pids[@]}"; do kill "$pid" 2>/dev/null || true; done
    # They write files until they end.
    for pid in "${pids[@]}"; do
        for ((i = 0; i < 100; i++)); do
            kill -0 "$pid" 2>/dev/null || break
            sleep 0.1
        done
    done
}

case "$action" in
up) up ;;
down) down ;;
*) usage ;;
esac
