"""The command line: one module per command, imported when it is called."""

from __future__ import annotations

import gc
import importlib
import sys
from typing import Any

import click

from lodeflow.errors import GraphError, LodeflowError, NodeError, did_you_mean
from lodeflow.registry import load_object, registry

COMMANDS: dict[str, str] = {
    "run": "Run a graph and record it.",
    "replay": "Run the graph of a recording again, from its recorded streams.",
    "info": "Say what is in a recording.",
    "study": "Run a graph over a grid of changes, into tables and figures.",
    "compare": "Compare two recordings: are they the same, and where not?",
    "recover": "Mend a recording that was killed or damaged, into a new file.",
    "plot": "Plot time series of recordings, into a file or a window.",
    "export": "Write streams of a recording into tables: CSV or Parquet.",
    "calibrate": "Find the parameters of a calibrator from recordings.",
    "check": "Check graph and study files: all errors, each with its place.",
    "graph": "Draw a graph.",
    "explain": "Say where a parameter of a graph gets its value.",
    "schema": "Print a JSON Schema of graph files, for editors.",
    "nodes": "List the installed plugins, or document one.",
    "new": "Write a plugin package with a passing test.",
    "import": "Turn a file of sensor data into a recording.",
    "ls": "List the running graphs, and their streams.",
    "echo": "Print the messages of a stream of a running graph.",
    "hz": "Measure the rates of the streams of a running graph.",
    "top": "Show what a running graph does: rates, latencies, losses, CPU, memory.",
    "set": "Set parameters of a running graph.",
    "swap": "Swap plugins of a running graph.",
    "stop": "End a running graph.",
}


class Commands(click.Group):
    """Loads a command's module only when it is asked for."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return [*COMMANDS, *registry().commands]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name in COMMANDS:
            module = importlib.import_module(f"lodeflow.cli.{cmd_name}_command")
            command: click.Command = module.command
            return command
        if cmd_name in registry().commands:
            found: click.Command = load_object(registry().commands[cmd_name].path)
            return found
        near = did_you_mean(cmd_name, self.list_commands(ctx))
        raise click.UsageError(f"no command {cmd_name!r}{near}", ctx)

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        # The texts stand here, so that --help imports no command.
        rows = [*COMMANDS.items(), *[(n, e.package) for n, e in registry().commands.items()]]
        with formatter.section("Commands"):
            formatter.write_dl(rows)


@click.group(cls=Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="lodeflow")
def cli() -> None:
    """Dataflow of small typed plugins, for heading and orientation sensing."""


def main(arguments: list[str] | None = None) -> None:
    """Run the command line; exit 0 good, 1 failed, 2 wrong usage or graph, 130 Ctrl-C.

    Args:
        arguments: what stands after `lodeflow`; None for what this process was started with.
    """
    try:
        code: Any = cli.main(arguments, prog_name="lodeflow", standalone_mode=False)
    except click.exceptions.Abort:
        code = 130
    except click.ClickException as error:
        error.show()
        code = 2
    except (GraphError, NodeError) as error:
        click.echo(str(error), err=True)
        code = 2
    except LodeflowError as error:
        click.echo(f"lodeflow: {error}", err=True)
        code = 1
    except KeyboardInterrupt:
        code = 130
    if arguments is None:
        # The process ends. Python would now look all objects through again and again, those of
        # numba for half a second: once is enough to close what was left open.
        gc.collect()
        gc.freeze()
    sys.exit(code if isinstance(code, int) else 0)
