"""Commands that check options of their own, or print text and paths rather than tables."""

import typer

from flexid.cli.generated import Command, Options, called, present, working
from flexid.cli.output import print_document, print_warnings
from flexid.errors import SettingError


def derive(command: Command, options: Options, flags: Options) -> None:
    """Print the equations, and on standard error what to know of them."""
    text = called(command, options, lambda _step: None)
    for note in text.notes:
        typer.echo(f"note: {note}", err=True)
    if flags["as_json"]:
        target = options.get("to", "latex")
        print_document({"model": options["model"], "to": target, "text": text, "notes": text.notes})
    else:
        typer.echo(text, nl=False)


def export(command: Command, options: Options, flags: Options) -> None:
    """Write the files, and print their paths."""
    from rich.console import Console

    if "columns" in options and "log" not in options:
        raise SettingError("--columns", "is for a log: name one with --log")
    errors = Console(stderr=True)
    with working(errors, command.doing):
        files = called(command, options, lambda _step: None)
    print_warnings(files.warnings, errors)
    paths = [str(path) for path in files.paths]
    if flags["as_json"]:
        print_document({"files": paths, "warnings": files.warnings})
    else:
        typer.echo("\n".join(paths))


def simulate(command: Command, options: Options, flags: Options) -> None:
    """Simulate, and hand the answer over."""
    if flags["csv"] and flags["out"] is None:
        raise SettingError("--csv", "has nowhere to write: name a directory with --out")
    present(command, options, flags)
