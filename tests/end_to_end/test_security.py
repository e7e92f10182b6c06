"""Two hosts with certificates, passwords and access control, as in docs/security.md."""

from __future__ import annotations

import json
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
import split_toys
import zenoh
from certificates import Authority
from command_line import CommandLine
from processes import free_port
from zenoh.handlers import FifoChannel

from lodeflow.transport.session import close_session, open_session

PROFILE = Path(__file__).parents[2] / "docs" / "security" / "robot.json5"
USERS = ("robot", "base", "operator", "viewer")


class Site:
    """A folder with certificates and the graph, and a profile for each user."""

    def __init__(self, toy: CommandLine) -> None:
        self.toy, self.folder = toy, toy.folder
        secrets = self.folder / "secrets"
        secrets.mkdir()
        ours, theirs = Authority(secrets), Authority(secrets, "their-ca")
        for user in USERS:
            ours.issue(user)
        theirs.issue("viewer", "forged")
        passwords = [f"{user}:{user}'s password\n" for user in USERS]
        (secrets / "users.txt").write_text("".join(passwords))
        toy.write("toys.py", split_toys.MODULE)
        toy.write("toy.yaml", split_toys.GRAPH)
        self.robot = self._profile("robot", "base")
        self.base = self._profile("base", "robot")
        self.links, self.window = free_port(), free_port()

    def _profile(self, me: str, other: str) -> Path:
        """Return the profile in docs/ with the hosts' names changed."""
        text = PROFILE.read_text()
        swapped = text.replace("base", "\0").replace("robot", me).replace("\0", other)
        return self.toy.write(f"{me}.json5", swapped)

    def visitor(self, name: str, certificate: str = "", password: str = "") -> Path:
        """Write the profile of somebody who only connects."""
        secrets = str(self.folder / "secrets")
        tls = {"root_ca_certificate": f"{secrets}/ca.pem", "enable_mtls": bool(certificate)}
        if certificate:
            tls["connect_certificate"] = f"{secrets}/{certificate}.pem"
            tls["connect_private_key"] = f"{secrets}/{certificate}.key"
        auth = {"usrpwd": {"user": name, "password": password}} if password else {}
        settings = {"transport": {"link": {"tls": tls}, "auth": auth}}
        return self.toy.write(f"{name}-{certificate}.json5", json.dumps(settings))

    def start(self, *arguments: str) -> tuple[subprocess.Popen[str], subprocess.Popen[str]]:
        """Start both hosts; the robot can be looked into."""
        robot = self.toy.start(
            *("run", "toy.yaml", "--only", "source", "--listen", f"tls/127.0.0.1:{self.links}"),
            *("--zenoh-listen", f"tls/127.0.0.1:{self.window}"),
            *("--zenoh-config", self.robot, *arguments),
        )
        base = self.toy.start(
            *("run", "toy.yaml", "--only", "gains,ends,recorder", "--zenoh-config", self.base),
            *("--connect", f"tls/127.0.0.1:{self.links}", *arguments),
        )
        return robot, base

    def connect(self, config: Path) -> zenoh.Session:
        """Open a session to the window of the robot."""
        return open_session(connect=[f"tls/127.0.0.1:{self.window}"], config=config)

    def client(self, config: Path) -> zenoh.Session:
        """Open a client's session, which is no peer's, to the links of the robot."""
        settings = zenoh.Config.from_file(str(config))
        settings.insert_json5("mode", '"client"')
        settings.insert_json5("connect/endpoints", json.dumps([f"tls/127.0.0.1:{self.links}"]))
        return zenoh.open(settings)


@pytest.fixture
def site(lodeflow: CommandLine) -> Site:
    return Site(lodeflow)


@pytest.fixture
def running(site: Site) -> tuple[subprocess.Popen[str], subprocess.Popen[str]]:
    robot, base = site.start("--realtime", "--arg", "seconds=60")
    until = time.monotonic() + 60
    session = site.connect(site.visitor("viewer", "viewer", "viewer's password"))
    seen = session.declare_subscriber("lodeflow/toy/ticks/out", FifoChannel(1 << 12))
    while seen.try_recv() is None:
        assert time.monotonic() < until, "no data"
        time.sleep(0.02)
    close_session(session)
    return robot, base


def test_two_hosts_with_certificates_and_passwords_record_the_same(site: Site) -> None:
    site.toy("run", "toy.yaml", "--processes", "one", "--arg", "seconds=5", "--record", "one.mcap")
    for process in site.start("--arg", "seconds=5", "--record", "hosts.mcap"):
        _, errors = process.communicate(timeout=60)
        assert process.returncode == 0, errors
        assert "refused" not in errors
    assert "the same" in site.toy("compare", "one.mcap", "hosts.mcap").stdout


def test_strangers_are_refused_and_told_of(site: Site, running: Any) -> None:
    strangers = {
        "no certificate": ("viewer", "", "viewer's password"),
        "a certificate of somebody else": ("viewer", "forged", "viewer's password"),
        "a wrong password": ("viewer", "viewer", "a guess"),
        "no password": ("viewer", "viewer", ""),
    }
    for what, who in strangers.items():
        session = site.connect(site.visitor(*who))
        seen = session.declare_subscriber("**", FifoChannel(16))
        time.sleep(0.5)
        assert not session.info.peers_zid(), what
        assert seen.try_recv() is None, what
        close_session(session)
    errors = ended(running)
    assert "a session was refused: peer sent no certificates" in errors
    assert "a session was refused: invalid peer certificate" in errors
    assert "a session was refused: invalid password" in errors
    assert "a session was refused: no user and password" in errors


def test_a_viewer_sees_the_streams_and_everything_else_is_refused_and_told_of(
    site: Site, running: Any
) -> None:
    config = site.visitor("viewer", "viewer", "viewer's password")
    viewer = site.connect(config)
    streams = viewer.declare_subscriber("lodeflow/**", FifoChannel(1 << 12))
    links = viewer.declare_subscriber("@lodeflow/toy/**", FifoChannel(1 << 12))
    time.sleep(0.5)
    assert streams.try_recv() is not None
    assert links.try_recv() is None
    close_session(viewer)
    insider = site.client(config)  # a peer would not even send what nobody asks for
    insider.put("@lodeflow/toy/to/source/ends", b"a frame of nobody")
    stop = json.dumps({"ask": "stop"})
    assert not list(insider.get("@lodeflow/toy/control/source", payload=stop, timeout=1.0))
    close_session(insider)
    operator = site.visitor("operator", "operator", "operator's password")
    at = ("--connect", f"tls/127.0.0.1:{site.window}", "--zenoh-config", operator)
    assert "ticks" in site.toy("ls", "-l", *at).stdout
    errors = ended(running)
    assert "refused: declare subscriber of @lodeflow/toy/** from viewer" in errors
    assert "refused: put of @lodeflow/toy/to/source/ends from viewer" in errors
    assert "refused: query of @lodeflow/toy/control/source from viewer" in errors


def ended(running: tuple[subprocess.Popen[str], subprocess.Popen[str]]) -> str:
    """Stop the run; return what the robot has said to standard error."""
    robot, base = running
    robot.terminate()
    output, errors = robot.communicate(timeout=30)
    assert "ThreadId" not in output + errors, "a line of Zenoh's own log"
    base.communicate(timeout=30)
    return errors
