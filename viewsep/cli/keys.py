"""`viewsep keys`."""

from __future__ import annotations

from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated

import typer
from rich.table import Table

from viewsep import keys
from viewsep.cli.console import people, print_json, results
from viewsep.keys import KeyRole

app = typer.Typer(
    help="Make the keys with which a service is reached over a network, and say who may do what.",
    no_args_is_help=True,
    rich_markup_mode="markdown",
)

Folder = Annotated[Path, typer.Option("--keys", help="The folder that `viewsep keys init` made.", metavar="FOLDER")]
Holder = Annotated[str, typer.Argument(help="Whose it is: up to 64 letters, digits, '_', '.' and '-'.", metavar="NAME")]
FOLDER = Path("keys")


@app.command()
def init(
    folder: Annotated[Path, typer.Argument(help="New folder, for the owner's eyes only.", metavar="FOLDER")] = FOLDER,
) -> None:
    """Make a private certificate authority and an empty register.

    Keep `ca.key` on this computer: whoever has it can make keys for everybody.

    Example:

        viewsep keys init keys
    """
    keys.init_keys(folder)
    people.print(f"made {folder}; next: viewsep keys issue rig --role rig", soft_wrap=True, highlight=False)


@app.command()
def issue(
    name: Holder,
    role: Annotated[
        KeyRole,
        typer.Option(help="rig and engine serve, an operator sees and commands, a viewer sees.", show_default=False),
    ],
    folder: Folder = FOLDER,
    host: Annotated[
        list[str] | None,
        typer.Option(help="DNS name or IP address others reach it by (rig, engine; repeatable).", metavar="HOST"),
    ] = None,
    days: Annotated[int, typer.Option(help="How long it is good.")] = keys.DAYS,
    renew: Annotated[bool, typer.Option("--renew", help="Replace what NAME has, also its role and hosts.")] = False,
) -> None:
    """Make a key and a certificate and enter the name into the register.

    Copy `ca.pem`, `NAME.pem` and `NAME.key` to the computer that uses them, for a rig or an engine also
    `register.json`. Services read the register when they start.

    Examples:

        viewsep keys issue rig --role rig --host rig.example.org --host 192.0.2.7

        viewsep keys issue ann --role operator

        viewsep keys issue ann --role operator --renew
    """
    keys.issue(folder, name, role, host or (), days, renew=renew)
    files = [f"{keys.CA}.pem", f"{name}.pem", f"{name}.key", *([keys.REGISTER] if role.serves else [])]
    people.print(
        f"issued {name}, {role.value}, for {days} days; it needs {', '.join(files)} from {folder}",
        soft_wrap=True,
        highlight=False,
    )


@app.command()
def revoke(name: Holder, folder: Folder = FOLDER) -> None:
    """Take a name out of the register, for good. Its files stay, but are worth nothing.

    Copy `register.json` to wherever a rig or an engine is served and restart them: they read it when they start.

    Example:

        viewsep keys revoke ann
    """
    keys.revoke(folder, name)
    people.print(
        f"revoked {name}; copy {folder / keys.REGISTER} to all services and restart them",
        soft_wrap=True,
        highlight=False,
    )


@app.command("list")
def list_names(
    folder: Folder = FOLDER, json: Annotated[bool, typer.Option("--json", help="Print the list as JSON.")] = False
) -> None:
    """List who is in the register, what they may do, and when their certificates expire.

    Example:

        viewsep keys list --json
    """
    entries = keys.describe(folder)
    if json:
        print_json(
            [
                {
                    "name": entry.name,
                    "role": entry.role.value,
                    "expires": entry.expires.isoformat() if entry.expires else None,
                }
                for entry in entries
            ]
        )
        return
    now = datetime.now(UTC)
    table = Table("name", "role", "expires")
    for entry in entries:
        expires = f"{entry.expires:%Y-%m-%d}" if entry.expires else "certificate not here"
        late = entry.expires is not None and entry.expires <= now
        table.add_row(entry.name, entry.role.value, f"{expires} (expired)" if late else expires)
    results.print(table)
