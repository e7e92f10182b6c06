"""`lodeflow new`."""

from __future__ import annotations

import importlib.util
import keyword
import re
from pathlib import Path
from string import Template

import click

from lodeflow.registry import registry

TEMPLATE = Path(__file__).parent / "template"
TAKEN = {"vehicle", "true", "false", "null", "yes", "no", "on", "off"}
"""The other node of the template's graph, and the words that YAML does not read as text."""


@click.group()
def command() -> None:
    """Write a plugin package with a passing test."""


@command.command()
@click.argument("name")
@click.option(
    "--into",
    type=click.Path(file_okay=False, path_type=Path),
    default=Path(),
    help="Folder to make the package in; the current one if not given.",
)
def node(name: str, into: Path) -> None:
    """Write a package with one node, a graph that runs it, and a test.

    NAME is what graph files will use, such as low_pass.
    """
    package = f"lodeflow_{name}"
    if why := _refusal(name, package):
        raise click.UsageError(f"{name!r} is no name for a plugin: {why}")
    words = {
        "name": name,
        "package": package,
        "distribution": package.replace("_", "-"),
        "node": "".join(part.capitalize() for part in name.split("_")),
    }
    folder = into / words["distribution"]
    try:
        if folder.exists():
            raise click.UsageError(f"{folder} exists; choose another name or remove it")
        _write(folder, words)
    except OSError as error:
        raise click.UsageError(f"{folder} cannot be written: {error.strerror}") from None
    click.echo(
        f'\nNext:\n  pip install -e "{folder}[test]"\n  pytest {folder}\n'
        f"  lodeflow run {folder}/graph.yaml"
    )


def _refusal(name: str, package: str) -> str:
    """Return why a package of that name would not work, or "" if it would."""
    if not re.fullmatch(r"[a-z][a-z0-9]*(_[a-z0-9]+)*", name) or keyword.iskeyword(name):
        return "use lower case and digits, with single _ between them, such as 'low_pass'"
    if name.startswith("test"):
        return "pytest would take the class for a test"
    if name in TAKEN:
        return "the graph in the package would misread it"
    if entry := registry().nodes.get(name):
        return f"{entry.package} brings one of that name; choose another"
    if importlib.util.find_spec(package) is not None:
        return f"the package {package} exists already; choose another"
    return ""


def _write(folder: Path, words: dict[str, str]) -> None:
    """Write the files of the template, with the words in their places."""
    for source in sorted(path for path in TEMPLATE.rglob("*.txt") if path.is_file()):
        # Template files end in .txt, so that no tool takes them for code of ours.
        relative = str(source.relative_to(TEMPLATE)).removesuffix(".txt")
        target = folder / relative.replace("PACKAGE", words["package"])
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(Template(source.read_text()).substitute(words))
        click.echo(f"wrote {target}")
