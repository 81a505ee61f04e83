"""What Snakemake says of a run of drapeline: a line per finished job, and how long it will take.

On a terminal, the last line shows what is going on, with the frames or steps that jobs are at.
Dry runs, warnings and errors are Snakemake's own.
"""

import re
import shutil
import sys
import threading
import time
from collections.abc import Callable, Mapping
from logging import WARNING, LogRecord
from pathlib import Path
from typing import Any, ClassVar

from snakemake.logging import ColorizingTextHandler, DefaultFilter, DefaultFormatter
from snakemake.settings.enums import Quietness
from snakemake_interface_logger_plugins.base import LogHandlerBase
from snakemake_interface_logger_plugins.common import LogEvent

from snakemake_logger_plugin_drapeline.estimate import Estimate, RunningJob, in_words

# What Snakemake says on the way to every run.
_USUAL = re.compile(
    r"Assuming unrestricted|Building DAG|Using shell|Provided |Rules claiming|Select jobs|"
    r"Complete log|Execute |Job stats|host:|\d+ of \d+ steps|$"
)
_CORES = re.compile(r"Provided cores: (\d+)")
_PROGRESS = re.compile(r" INFO ([^:\n]+: \d+ of \d+)")  # as `drapeline.rule_log.progress` logs it
_REFRESH_S = 1.0
_WORDS = {
    *(LogEvent.ERROR, LogEvent.DEBUG_DAG, LogEvent.SHELLCMD),
}


class LogHandler(LogHandlerBase):
    """Snakemake's handler of log records for `logger: drapeline` in a profile."""

    writes_to_stream = True
    writes_to_file = False
    has_filter = True
    has_formatter = True
    needs_rulegraph = False

    def __post_init__(self) -> None:
        """Begin without jobs."""
        given = self.common_settings
        self._stream = sys.stdout if given.stdout else sys.stderr
        formatter = DefaultFormatter(given.quiet, given.show_failed_logs)
        self._plain = ColorizingTextHandler(given.nocolor, self._stream, formatter)
        self._plain.addFilter(
            DefaultFilter(
                given.quiet, given.debug_dag, given.verbose, given.dryrun, given.printshellcmds
            )
        )
        self._lock = threading.RLock()
        self._estimate = Estimate()
        self._running: dict[int, RunningJob] = {}
        self._over = threading.Event()
        self._quiet = bool({Quietness.ALL, Quietness.PROGRESS} & set(given.quiet or ()))
        if self._stream.isatty() and not given.dryrun and not self._quiet:
            threading.Thread(target=self._refresh, daemon=True).start()

    def emit(self, record: LogRecord) -> None:
        """Say what a record is about, if it is for people to know."""
        event: Any = getattr(record, "event", None)
        try:
            with self._lock:
                if self.common_settings.dryrun:
                    self._plain.handle(record)
                elif note := self._NOTED.get(event):
                    note(self, record)
                elif event in _WORDS or record.levelno >= WARNING:
                    self._say_plainly(record)
                elif event in (None, LogEvent.RESOURCES_INFO):
                    self._note(record)
        except Exception:  # as handlers do: what cannot be said must not end the run
            self.handleError(record)

    def close(self) -> None:
        """Take the last line away."""
        self._over.set()
        with self._lock:
            self._clear()
        super().close()

    def _note(self, record: LogRecord) -> None:
        text = str(record.msg or "")
        if cores := _CORES.match(text):
            self._estimate.cores = int(cores[1])
        if not _USUAL.match(text):
            self._say_plainly(record)

    def _plan(self, record: LogRecord) -> None:
        stats: dict[str, int] = dict(getattr(record, "stats", None) or {})
        total = stats.pop("total", 0)
        self._estimate.plan(stats)
        if total and not self._estimate.done:
            left = self._estimate.left_s()
            about = f", about {in_words(left)} by the default experiment's times" if left else ""
            self._say(f"{total} jobs to do{about}")

    def _start(self, record: LogRecord) -> None:
        info: dict[str, Any] = vars(record)
        values = " ".join(str(value) for value in dict(info["wildcards"]).values() if value)
        name = f"{info['rule_name']} {values}".rstrip()
        log = info["log"][0] if info["log"] else ""
        job = RunningJob(info["rule_name"], name, log, time.monotonic())
        self._running[info["jobid"]] = job

    def _finish(self, record: LogRecord) -> None:
        job = self._running.pop(vars(record)["job_id"], None)
        if job is None:
            return
        took = time.monotonic() - job.started
        self._estimate.finish(job.rule, took)
        self._say(f"{job.name} took {in_words(took)} ({self._state()})")

    def _end(self, record: LogRecord) -> None:
        self._running.pop(getattr(record, "jobid", -1), None)
        self._say_plainly(record)

    def _state(self) -> str:
        done, total = self._estimate.done, self._estimate.total
        left = self._estimate.left_s(list(self._running.values()))
        return f"{done} of {total} done" + (f", about {in_words(left)} left" if left else "")

    def _end_group(self, record: LogRecord) -> None:
        for job in getattr(record, "job_error_info", None) or ():
            self._running.pop(job.get("jobid", -1), None)
        self._say_plainly(record)

    def _say(self, text: str) -> None:
        if self._quiet:
            return
        self._clear()
        print(time.strftime("%H:%M:%S"), text, file=self._stream, flush=True)

    def _say_plainly(self, record: LogRecord) -> None:
        self._clear()
        self._plain.handle(record)

    def _clear(self) -> None:
        if self._stream.isatty() and not self.common_settings.dryrun:
            print("\r\x1b[K", end="", file=self._stream, flush=True)

    def _refresh(self) -> None:
        """Show the state of affairs again and again, in the last line."""
        while not self._over.wait(_REFRESH_S):
            with self._lock:
                if self._running and not self._over.is_set():
                    jobs = [_progress_of(job) for job in self._running.values()]
                    text = "; ".join([self._state(), *jobs])
                    width = shutil.get_terminal_size().columns - 1
                    # The cursor goes back, so that what jobs say begins at the margin.
                    print(f"\r\x1b[K{text[:width]}\r", end="", file=self._stream, flush=True)

    _NOTED: ClassVar[Mapping[LogEvent, Callable[["LogHandler", LogRecord], None]]] = {
        LogEvent.RUN_INFO: _plan,
        LogEvent.JOB_INFO: _start,
        LogEvent.JOB_FINISHED: _finish,
        LogEvent.JOB_ERROR: _end,
        LogEvent.GROUP_ERROR: _end_group,
    }


def _progress_of(job: RunningJob) -> str:
    """A job, and how far it is by the end of its log."""
    try:
        with open(job.log, "rb") as stream:
            stream.seek(max(0, Path(job.log).stat().st_size - 1000))
            found = _PROGRESS.findall(stream.read().decode(errors="replace"))
    except OSError:
        found = []
    return f"{job.name} ({found[-1]})" if found else job.name
