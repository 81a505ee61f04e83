"""Snakemake's jobs as Kubernetes' by `kubectl`: submit one, ask for its state.

A job's container runs the script that Snakemake wrote to the folder that all of them share.
"""

import argparse
import json
import re
import subprocess
import sys
import time
from pathlib import Path


def submit(args):
    """Create a job and print its name."""
    limits = {"cpu": str(args.cores), "memory": f"{args.mb}Mi"}
    if args.gpus:
        limits["nvidia.com/gpu"] = str(args.gpus)
    rule = re.sub("[^a-z0-9]+", "-", args.name.lower()).strip("-")[:40]
    container = {
        "name": "job",
        "image": args.image,
        "command": ["sh", args.script],
        "workingDir": str(Path.cwd()),
        "resources": {"requests": limits, "limits": limits},
        "volumeMounts": [{"name": "shared", "mountPath": args.folder}],
    }
    volume = {"name": "shared", "persistentVolumeClaim": {"claimName": args.claim}}
    pod = {
        "activeDeadlineSeconds": 60 * args.minutes,  # from when it is on a node
        "restartPolicy": "Never",
        "containers": [container],
        "volumes": [volume],
    }
    job = {
        "apiVersion": "batch/v1",
        "kind": "Job",
        "metadata": {"generateName": f"drapeline-{rule}-"},
        # Snakemake tries again by itself.
        "spec": {"backoffLimit": 0, "ttlSecondsAfterFinished": 86400, "template": {"spec": pod}},
    }
    print(kubectl("create", "-f", "-", "-o", "name", text=json.dumps(job)).strip())


def status(args):
    """Print "running", "success" or "failed"; a job that is gone has failed."""
    found = kubectl("get", args.job, "--ignore-not-found", "-o", "json")
    counts = json.loads(found).get("status", {}) if found.strip() else {"failed": 1}
    states = [
        word for key, word in (("succeeded", "success"), ("failed", "failed")) if counts.get(key)
    ]
    print(states[0] if states else "running")


def kubectl(*words, text=None):
    """What the command prints; a question is asked again where a cluster is out of reach."""
    for wait_s in (1, 5, 0) if words[0] == "get" else (0,):
        done = subprocess.run(["kubectl", *words], input=text, stdout=subprocess.PIPE, text=True)
        if not done.returncode:
            return done.stdout
        time.sleep(wait_s)
    sys.exit(done.returncode)


def main():
    """Run the command of the arguments."""
    parser = argparse.ArgumentParser(description=__doc__)
    commands = parser.add_subparsers(required=True)
    one = commands.add_parser("submit")
    for name in ("image", "claim", "folder", "name"):
        one.add_argument(f"--{name}", required=True)
    for name in ("cores", "mb", "gpus", "minutes"):
        one.add_argument(f"--{name}", type=int, required=True)
    one.add_argument("script")
    one.set_defaults(run=submit)
    one = commands.add_parser("status")
    one.add_argument("job")
    one.set_defaults(run=status)
    args = parser.parse_args()
    args.run(args)


if __name__ == "__main__":
    main()
