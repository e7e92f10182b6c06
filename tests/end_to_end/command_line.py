"""The real command line, in processes of its own."""

from __future__ import annotations

import io
import logging
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import chdir, redirect_stderr, redirect_stdout
from pathlib import Path

import pytest

from lodeflow.cli import main

COMMAND = [sys.executable, "-W", "error", "-m", "lodeflow.cli"]


class CommandLine:
    """Runs lodeflow in a folder."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.started: list[subprocess.Popen[str]] = []
        self.environment = {**os.environ, "PYTHONPATH": str(folder), "COLUMNS": "200"}
        # Runs of other tests, and of whoever runs the tests, are none of ours.
        self.runtime = Path(tempfile.mkdtemp(prefix="lf-"))
        self.environment["XDG_RUNTIME_DIR"] = str(self.runtime)

    def __call__(self, *arguments: object, code: int = 0) -> subprocess.CompletedProcess[str]:
        """Run to the end and check the exit code."""
        done = subprocess.run(
            [*COMMAND, *map(str, arguments)],
            cwd=self.folder,
            env=self.environment,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == code, f"{done.returncode}\n{done.stdout}\n{done.stderr}"
        assert "Traceback" not in done.stderr, done.stderr
        return done

    def start(self, *arguments: object, before: Sequence[str] = ()) -> subprocess.Popen[str]:
        """Start, and leave it running; it is killed at the end of the test if it still does.

        `before` is a command that runs the one after it, elsewhere.
        """
        process = subprocess.Popen(
            [*before, *COMMAND, *map(str, arguments)],
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            # Where the tests run in the background, SIGINT is ignored, and would be in there too.
            preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        )
        self.started.append(process)
        return process

    def end(self) -> None:
        """Kill what still runs, and close what nobody has read to its end."""
        for process in self.started:
            if process.poll() is None:
                process.kill()
                process.communicate()
            for pipe in (process.stdout, process.stderr):
                if pipe is not None:
                    pipe.close()
        shutil.rmtree(self.runtime, ignore_errors=True)

    def write(self, name: str, text: str) -> Path:
        """Write a file into the folder."""
        path = self.folder / name
        path.write_text(text)
        return path


class InProcess(CommandLine):
    """The same in this process, where nothing needs to be imported and compiled again."""

    def __call__(self, *arguments: object, code: int = 0) -> subprocess.CompletedProcess[str]:
        done = self.attempt(*arguments)
        assert done.returncode == code, done.stderr
        return done

    def attempt(self, *arguments: object) -> subprocess.CompletedProcess[str]:
        """Run to the end, whatever the exit code."""
        words = list(map(str, arguments))
        out, err = io.StringIO(), io.StringIO()
        logger = logging.getLogger("lodeflow")
        handlers = list(logger.handlers)
        with chdir(self.folder), redirect_stdout(out), redirect_stderr(err):
            with pytest.raises(SystemExit) as done:
                main(words)
            logger.handlers = handlers
        code = done.value.code
        assert isinstance(code, int)
        return subprocess.CompletedProcess(words, code, out.getvalue(), err.getvalue())
