"""What is said of a run: its progress on a terminal, and its summary."""

from __future__ import annotations

from collections.abc import Mapping

from rich.console import Group
from rich.live import Live
from rich.text import Text

from lodeflow.cli.output import RESULT, STATUS, print_json, score_lines, table
from lodeflow.clock import monotonic
from lodeflow.runtime.plan import Counters
from lodeflow.supervisor.summary import Summary


def report(summary: Summary, *, as_json: bool = False) -> int:
    """Print a summary, the error that ended the run to standard error; return the exit code."""
    if as_json:
        print_json(summary.as_dict())
    else:
        show(summary)
    if summary.error is not None:
        STATUS.print(Text(f"lodeflow: {summary.error}", style="red"), soft_wrap=True)
    return summary.exit_code


def show(summary: Summary) -> None:
    """Print a summary: samples per stream, losses, scores, the recording's path."""
    streams = table("stream", ">samples", ">rate", "")
    for name, counters in summary.counters.items():
        for port, count in counters.sent.items():
            stream = name if port == "out" else f"{name}.{port}"
            rate = f"{(count - 1) / summary.span:.4g} Hz" if summary.span > 0 < count - 1 else ""
            streams.add_row(stream, str(count), rate, "")
    RESULT.print(streams)
    notes = []
    for name, counters in summary.counters.items():
        if counters.unmatched:
            notes.append(f"{name}: {counters.unmatched} rows without partner")
        if counters.gated:
            notes.append(f"{name}: {counters.gated} rows held back by a gate")
        notes += [f"{name}: LOST {count} ({why})" for why, count in counters.lost.items()]
    for reader, peers in summary.links.items():
        for peer, losses in peers.items():
            told = ", ".join(f"{count} {what}" for what, count in losses.items() if count)
            notes.append(f"link of {reader} and {peer}: {told}")
    notes += [f"group {group}: began anew {n} times" for group, n in summary.restarts.items()]
    for note in notes:
        RESULT.print(note, style="yellow" if "LOST" in note else None)
    if summary.scores:
        RESULT.print()
        scores = table("score", ">value")
        for name, score in summary.scores.items():
            for row in score_lines(name, score):
                scores.add_row(*row)
        RESULT.print(scores)
    RESULT.print()
    speed = f", {_figures(summary.span / summary.wall)} times real time" if summary.wall else ""
    RESULT.print(f"{summary.span:.6g} s of data in {summary.wall:.2f} s{speed}")
    if summary.stopped:
        RESULT.print("stopped before the end of the data")
    if summary.recording is not None:
        RESULT.print(f"recorded to {summary.recording}", soft_wrap=True)


def _figures(ratio: float) -> str:
    return f"{ratio:.0f}" if ratio >= 10 else f"{ratio:.2g}"


class Progress:
    """Rates and event time on a terminal, while the run goes on; nothing elsewhere.

    Args:
        forks: the run forks processes, which must not get their standard streams from here.
    """

    def __init__(self, *, forks: bool = False) -> None:
        self._live = Live(
            console=STATUS,
            transient=True,
            auto_refresh=False,
            redirect_stdout=not forks,
            redirect_stderr=not forks,
        )
        self._shown = False
        self._before: tuple[float, int] = (monotonic(), 0)

    def __enter__(self) -> Progress:
        if STATUS.is_terminal:
            self._live.start()
            self._shown = True
        return self

    def __exit__(self, *_: object) -> None:
        if self._shown:
            self._live.stop()

    def say(self, group: str, line: str) -> None:
        """Print a line of a process above the table."""
        STATUS.print(Text(f"[{group}] {line}"), soft_wrap=True)

    def __call__(self, nodes: Mapping[str, Counters], t: int) -> None:
        if not self._shown:
            return
        now, total = monotonic(), 0
        rows = table("node", ">stepped", ">sent", ">lost")
        for name, counters in nodes.items():
            sent = sum(counters.sent.values())
            total += sent
            lost = sum(counters.lost.values())
            rows.add_row(name, str(counters.stepped), str(sent), str(lost or ""))
        then, before = self._before
        rate = (total - before) / max(now - then, 1e-9)
        line = f"t = {t / 1e9:.3f} s, {rate:,.0f} messages/s"
        self._before = (now, total)
        self._live.update(Group(rows, line), refresh=True)
