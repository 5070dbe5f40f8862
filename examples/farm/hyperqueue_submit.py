#!/usr/bin/env python3
"""Runs a job file of HyperQueue (`relight plan --format hq`) on a LocalCluster: a server and a worker in this process.

The wheel has no `hq job submit-file`; this hands the file's tasks and their order to its Python interface instead.
"""

import os
import sys
import tempfile
import tomllib
from pathlib import Path

from hyperqueue import Job, LocalCluster
from hyperqueue.cluster import WorkerConfig


def main(path: Path) -> None:
    described = tomllib.loads(path.read_text())
    with tempfile.TemporaryDirectory() as folder:
        job = Job(name=described["name"], default_workdir=folder, max_fails=1)
        tasks = {}
        for task in described["task"]:
            before = [tasks[number] for number in task.get("deps", [])]
            tasks[task["id"]] = job.program(task["command"], deps=before, name=f"{described['name']}-{task['id']}")
        with LocalCluster(os.path.join(folder, "server"), WorkerConfig(cores=os.cpu_count())) as cluster:
            client = cluster.client()
            client.wait_for_jobs([client.submit(job)])
        for said in sorted(Path(folder).glob("*.stdout")):
            print(said.read_text(), end="")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
