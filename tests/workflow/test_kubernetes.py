"""The profile for Kubernetes, with a `kubectl` that is none."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from toys.snakemake_run import ROOT, snakemake

PROFILE = Path("workflow/profiles/kubernetes")
CONFIG = yaml.safe_load((ROOT / PROFILE / "config.yaml").read_text())
# Notes what it is told, runs the jobs that it is given, and says what it is told to.
KUBECTL = """\
#!{python}
import json, pathlib, subprocess, sys
folder = pathlib.Path(__file__).parent
words = sys.argv[1:]
given = sys.stdin.read() if words[0] == "create" else ""
with open(folder / "calls", "a") as calls:
    calls.write(json.dumps([words, given]) + "\\n")
answer = json.loads((folder / "answer").read_text())
if answer["fails"]:
    sys.exit("error: the cluster is not there")
if words[0] == "create":
    (job,) = json.loads(given)["spec"]["template"]["spec"]["containers"]
    if answer["runs"]:
        done = subprocess.run(job["command"], cwd=job["workingDir"], capture_output=True)
        answer["status"] = {{"failed" if done.returncode else "succeeded": 1}}
        (folder / "answer").write_text(json.dumps(answer))
    print("job.batch/drapeline-x")
elif words[0] == "get" and answer["gone"]:
    if "--ignore-not-found" not in words:
        sys.exit('Error from server (NotFound): jobs.batch "drapeline-x" not found')
elif words[0] == "get":
    print(json.dumps({{"status": answer["status"]}} if answer["status"] is not None else {{}}))
"""


class Cluster:
    """A fake `kubectl` in a folder."""

    def __init__(self, folder):
        self.folder = folder
        (folder / "kubectl").write_text(KUBECTL.format(python=sys.executable))
        (folder / "kubectl").chmod(0o755)
        self.answer()

    def answer(self, status=None, *, runs=False, fails=False, gone=False):
        """What it is to say of jobs from now on, and whether it runs and still knows them."""
        said = {"status": status, "runs": runs, "fails": fails, "gone": gone}
        (self.folder / "answer").write_text(json.dumps(said))

    @property
    def calls(self):
        """The words of each call, and what it was given."""
        path = self.folder / "calls"
        return [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []

    @property
    def created(self):
        """The last manifest."""
        return json.loads(next(given for words, given in self.calls[::-1] if words[0] == "create"))


@pytest.fixture
def cluster(tmp_path, monkeypatch):
    (tmp_path / "bin").mkdir()
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=os.pathsep)
    return Cluster(tmp_path / "bin")


def call(tmp_path, *words):
    run = [sys.executable, str(ROOT / PROFILE / "jobs.py"), *map(str, words)]
    return subprocess.run(run, cwd=tmp_path, capture_output=True, text=True)


def submit(tmp_path, rule="train", gpus=0, minutes=90):
    about = {"image": "here/drapeline:1", "claim": "data", "folder": "/shared", "name": rule}
    about |= {"cores": 3, "mb": 5000, "gpus": gpus, "minutes": minutes}
    words = [word for key, value in about.items() for word in (f"--{key}", value)]
    return call(tmp_path, "submit", *words, tmp_path / "job.sh")


def test_a_job_gets_what_its_rule_asks_for(tmp_path, cluster):
    run = submit(tmp_path)
    assert (run.returncode, run.stdout) == (0, "job.batch/drapeline-x\n"), run.stderr
    ((words, _),) = cluster.calls
    assert words[0] == "create"
    assert cluster.created["kind"] == "Job"
    spec = cluster.created["spec"]
    assert spec["backoffLimit"] == 0  # Snakemake tries again by itself
    pod = spec["template"]["spec"]
    assert pod["activeDeadlineSeconds"] == 90 * 60
    assert pod["restartPolicy"] == "Never"
    (container,) = pod["containers"]
    assert container["image"] == "here/drapeline:1"
    assert container["command"] == ["sh", str(tmp_path / "job.sh")]
    assert container["workingDir"] == str(tmp_path)
    asked = {"cpu": "3", "memory": "5000Mi"}
    assert container["resources"] == {"requests": asked, "limits": asked}
    (mount,), (volume,) = container["volumeMounts"], pod["volumes"]
    assert mount == {"name": volume["name"], "mountPath": "/shared"}
    assert volume["persistentVolumeClaim"] == {"claimName": "data"}


def test_a_job_gets_gpus_only_where_it_asks_for_some(tmp_path, cluster):
    submit(tmp_path, gpus=2)
    (container,) = cluster.created["spec"]["template"]["spec"]["containers"]
    for kind in ("requests", "limits"):
        assert container["resources"][kind]["nvidia.com/gpu"] == "2"


@pytest.mark.parametrize("rule", ["train", "fit_own_scans", "Rule__7_", "_", "r" * 90])
def test_every_rule_gives_a_name_that_kubernetes_takes(tmp_path, cluster, rule):
    submit(tmp_path, rule)
    name = cluster.created["metadata"]["generateName"] + "x7b2k"
    assert re.fullmatch("[a-z0-9]([-a-z0-9]*[a-z0-9])?", name)
    assert len(name + "-x7b2k") <= 63  # its pod's name is longer


@pytest.mark.parametrize(
    ("status", "word"),
    [
        (None, "running"),
        ({}, "running"),
        ({"active": 1, "succeeded": 0}, "running"),
        ({"succeeded": 1}, "success"),
        ({"failed": 1}, "failed"),
    ],
)
def test_states_are_those_that_snakemake_knows(tmp_path, cluster, status, word):
    cluster.answer(status)
    run = call(tmp_path, "status", "job.batch/drapeline-x")
    assert (run.returncode, run.stdout) == (0, f"{word}\n")
    ((words, _),) = cluster.calls
    assert words[:2] == ["get", "job.batch/drapeline-x"]


def test_a_job_that_somebody_has_deleted_has_failed(tmp_path, cluster):
    cluster.answer(gone=True)
    run = call(tmp_path, "status", "job.batch/drapeline-x")
    assert (run.returncode, run.stdout, run.stderr) == (0, "failed\n", "")
    assert len(cluster.calls) == 1


def test_cancelling_deletes_all_jobs(cluster):
    """As Snakemake does it, which takes no words besides the command's name."""
    jobs = ["job.batch/drapeline-x", "job.batch/drapeline-y"]
    subprocess.run([CONFIG["cluster-generic-cancel-cmd"], *jobs], cwd=ROOT, check=True)
    ((words, _),) = cluster.calls
    assert words[0] == "delete"
    assert words[-2:] == jobs


def test_what_kubectl_cannot_do_is_passed_on(tmp_path, cluster):
    cluster.answer(fails=True)
    asked_again = call(tmp_path, "status", "job.batch/drapeline-x")
    for run, times in ((submit(tmp_path), 1), (asked_again, 3)):
        assert run.returncode == 1
        assert run.stdout == ""
        assert run.stderr == times * "error: the cluster is not there\n"


def test_the_workflow_is_planned_with_the_profile(project):
    run = snakemake(
        project,
        *("--workflow-profile", str(ROOT / PROFILE), "--dry-run", "dataset"),
        *("--configfile", "tests/data/tiny.yaml"),
    )
    assert run.returncode == 0, run.stderr
    assert f"specific profile {ROOT / PROFILE} for" in run.stderr
    assert "simulate_outfits" in run.stdout + run.stderr


RULE = """
rule make_it:
    output: "made.txt"
    threads: 2
    resources: mem_mb=300, gpu=1, runtime=7
    shell: "{command} > {{output}}"
"""


@pytest.mark.parametrize(("command", "fine"), [("echo done", True), ("exit 1", False)])
def test_snakemake_submits_jobs_and_hears_how_they_end(tmp_path, cluster, command, fine):
    cluster.answer(runs=True)
    shutil.copytree(ROOT / PROFILE, tmp_path / PROFILE)
    (tmp_path / "Snakefile").write_text(RULE.format(command=command))
    words = f"--workflow-profile {PROFILE} --retries 0 --seconds-between-status-checks 1 made.txt"
    run = snakemake(tmp_path, *words.split())
    assert (run.returncode == 0) is (tmp_path / "made.txt").is_file() is fine, run.stderr
    assert cluster.created["metadata"]["generateName"].startswith("drapeline-make-it-")
    pod = cluster.created["spec"]["template"]["spec"]
    assert pod["activeDeadlineSeconds"] == 7 * 60
    (container,) = cluster.created["spec"]["template"]["spec"]["containers"]
    asked = {"cpu": "2", "memory": "300Mi", "nvidia.com/gpu": "1"}
    assert container["resources"]["limits"] == asked
    assert container["workingDir"] == str(tmp_path)
