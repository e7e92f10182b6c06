"""`lodeflow new`."""

from __future__ import annotations

import keyword
import re
from pathlib import Path
from string import Template

import click

TEMPLATE = Path(__file__).parent / "template"


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
    if not re.fullmatch(r"[a-z][a-z0-9_]*", name) or keyword.iskeyword(name):
        raise click.UsageError(
            f"{name!r} is no name for a plugin; use lower case, digits and _, such as 'low_pass'"
        )
    package = f"lodeflow_{name}"
    words = {
        "name": name,
        "package": package,
        "distribution": package.replace("_", "-"),
        "node": "".join(part.capitalize() for part in name.split("_")),
    }
    folder = into / words["distribution"]
    if folder.exists():
        raise click.UsageError(f"{folder} exists; choose another name or remove it")
    for source in sorted(path for path in TEMPLATE.rglob("*.txt") if path.is_file()):
        # Template files end in .txt, so that no tool takes them for code of ours.
        relative = str(source.relative_to(TEMPLATE)).removesuffix(".txt")
        target = folder / relative.replace("PACKAGE", package)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_text(Template(source.read_text()).substitute(words))
        click.echo(f"wrote {target}")
    click.echo(
        f"\nNext:\n  pip install -e {folder}\n  pytest {folder}\n  lodeflow run {folder}/graph.yaml"
    )
