"""Refusals: whom and what Zenoh turned away for reasons of security, told in lodeflow's log.

Zenoh says so in its own log alone, on standard output; and of refused keys only at the lowest
level, among a line for each message that passes. So standard output goes through here while
sessions with a configuration file are open: Zenoh's lines are read, all others go on as they are.
"""

from __future__ import annotations

import logging
import os
import re
import sys
import threading
from collections import Counter

import zenoh

SESSIONS = ",".join(
    [
        "off",
        "zenoh_link_tls=warn",
        "zenoh_transport::unicast::establishment::accept=debug",
        "zenoh_transport::unicast::establishment::open=error",
        "zenoh::net::runtime::orchestrator=debug",
    ]
)
"""Zenoh's log, as far as it tells of refused sessions."""
KEYS = "zenoh::net::routing::interceptor::access_control=trace"
"""Likewise, of refused keys."""
MOST = 1000
"""Refusals of different kinds that are told; strangers cannot fill the log, or our memory."""

_LOG_LINE = re.compile(r"\d{4}-\d\d-\d\dT[\d:.]+Z +[A-Z]+ +(.*?ThreadId\(\d+\)) ([\w:]+): (.*)")
_CACHING = re.compile(r"ACL \((?:in|e)gress\): caching permissions for `(.*)` ")
_KEY = re.compile(
    r"(Using cached result: )?([0-9a-f]+)(?: on (\S+))? is unauthorized to "
    r"(.+) \((in|e)gress\) on (.*)"
)
_UNKNOWN = re.compile(r"([0-9a-f]+) did not match any configured ACL subject.*`Deny`")
_CREDENTIAL = re.compile(r"(CertCommonName|Username)\(([^)]*)\)")
_ACCEPT = re.compile(r"UsrPwd extension - Recv \w+\. (.*?)\.? at ")
_TLS = re.compile(r"(.*?)\. Hint: ")
_OPEN = re.compile(r"Received a close message .*?(?:=> |dst: )(\w+/[^ ,]+)")
_CONNECT = re.compile(
    r"Unable to connect to configured peer (\S+)! "
    r"(received fatal alert.*?|invalid peer cert.*?) at "
)
_AUTHORIZED = b" is authorized to "


class Refusals:
    """Reads Zenoh's log line by line, and tells each refusal once, and then ever more rarely.

    Args:
        logger: gets the warnings.
    """

    def __init__(self, logger: logging.Logger) -> None:
        self._logger = logger
        self._count: Counter[str] = Counter()
        self._names: dict[str, str] = {}
        self._cached: tuple[str, str] = ("", "")

    def read(self, line: str) -> bool:
        """Take a line of standard output; return whether it is of Zenoh's log."""
        found = _LOG_LINE.match(line)
        if found is None:
            return False
        thread, target, said = found.groups()
        told = self._refused(thread, target, said)
        if told is not None:
            self._tell(told)
        return True

    def _refused(self, thread: str, target: str, said: str) -> str | None:
        """Return what a line says was refused; None if it says something else."""
        if target.endswith("access_control"):
            return self._refused_key(thread, said)
        if target == "zenoh_link_tls::unicast" and (found := _TLS.match(said)):
            return f"a session was refused: {found[1]}"
        if target.endswith("accept") and (found := _ACCEPT.match(said)):
            why = "no user and password" if found[1] == "Expected extension" else found[1].lower()
            return f"a session was refused: {why}"
        if target.endswith("open") and (found := _OPEN.match(said)):
            return f"{found[1]} refused our session; are user and password right?"
        if target.endswith("orchestrator") and (found := _CONNECT.match(said)):
            return f"{found[1]}: no session: {found[2]}; are the certificates right?"
        return None

    def _refused_key(self, thread: str, said: str) -> str | None:
        if found := _CACHING.match(said):  # what would be refused of this key follows
            self._cached = (thread, found[1])
            return None
        if found := _UNKNOWN.match(said):
            return f"all keys are refused to a session of no known user ({found[1]})"
        found = _KEY.match(said)
        if found is None:
            return None
        really, session, subject, what, way, key = found.groups()
        if subject is not None and len(self._names) < MOST:
            names = [value for _, value in _CREDENTIAL.findall(subject)]
            self._names[session] = " ".join(dict.fromkeys(names)) or "a session without name"
        if not really and (thread, key) == self._cached:
            return None
        name = self._names.get(session, session)
        return f"refused: {what.lower()} of {key} {'from' if way == 'in' else 'to'} {name}"

    def _tell(self, refusal: str) -> None:
        if refusal not in self._count and len(self._count) >= MOST:
            refusal = "further refusals"
        self._count[refusal] += 1
        count = self._count[refusal]
        if count == 1:
            self._logger.warning("%s", refusal)
        elif str(count).strip("0") == "1":
            self._logger.warning("%s (%d times)", refusal, count)


class _StandardOutput:
    """Standard output of this process, led through `Refusals`."""

    def __init__(self) -> None:
        self._refusals = Refusals(logging.getLogger("lodeflow.zenoh"))
        self._out = os.dup(1)
        self._in, pipe = os.pipe()
        sys.stdout.flush()
        os.dup2(pipe, 1)
        os.close(pipe)
        self._thread = threading.Thread(target=self._read, name="refusals", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Put standard output back, after all that is on its way."""
        sys.stdout.flush()
        os.dup2(self._out, 1)
        self._thread.join()
        os.close(self._in)
        os.close(self._out)

    def _read(self) -> None:
        rest = b""
        while data := os.read(self._in, 1 << 16):
            *lines, rest = (rest + data).split(b"\n")
            for line in lines:
                if _AUTHORIZED not in line and not self._refusals.read(
                    line.decode("utf-8", "replace")
                ):
                    self._write(line + b"\n")
        self._write(rest)

    def _write(self, data: bytes) -> None:
        while data:
            data = data[os.write(self._out, data) :]


_sessions = 0
_output: _StandardOutput | None = None


def begin(*, keys: bool) -> None:
    """Tell refusals from now on; called before a session is opened, on the main thread.

    With RUST_LOG in the environment, Zenoh's own log goes to standard output in their place.

    Args:
        keys: also those of keys, which costs some microseconds for each message.
    """
    global _sessions, _output
    _sessions += 1
    if "RUST_LOG" in os.environ:
        zenoh.try_init_log_from_env()  # type: ignore[no-untyped-call]
        return
    if _output is None:
        _output = _StandardOutput()
        before = os.environ.get("NO_COLOR")
        os.environ["NO_COLOR"] = "1"  # else the lines are full of escapes
        zenoh.init_log_from_env_or(f"{SESSIONS},{KEYS}" if keys else SESSIONS)
        del os.environ["NO_COLOR"]
        if before is not None:
            os.environ["NO_COLOR"] = before


def end() -> None:
    """Undo `begin`, after the session was closed."""
    global _sessions, _output
    _sessions -= 1
    if not _sessions and _output is not None:
        _output.close()
        _output = None
