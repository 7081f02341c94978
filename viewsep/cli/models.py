"""`viewsep models`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.table import Column, Table

from viewsep.cli.console import people, print_json, results
from viewsep.cli.default_command import DefaultsToFirst
from viewsep.cli.models_check import check
from viewsep.models import library

app = typer.Typer(
    cls=DefaultsToFirst,
    help="""List the models of a library, or check which of them are hard to tell apart.

    Examples:

        viewsep models library

        viewsep models check library
    """,
    rich_markup_mode="markdown",
)


@app.command("list")
def models(
    folder: Annotated[Path, typer.Argument(help="Library folder.", metavar="LIBRARY", show_default=False)],
    plot: Annotated[Path | None, typer.Option(help="Draw a contact sheet of all views (PNG).")] = None,
    json: Annotated[bool, typer.Option("--json", help="Print the list as JSON.")] = False,
) -> None:
    """List the models of a library: views, bytes, descriptor, hash.

    Examples:

        viewsep models library

        viewsep models library --plot library.png
    """
    known = library.load_library(folder)
    rows = [
        {
            "name": model.name,
            "views": len(model.directions),
            "edges": len(model.edges),
            "bytes": (folder / f"{model.name}{library.SUFFIX}").stat().st_size,
            "descriptor": model.descriptor,
            "descriptor_parameters": model.descriptor_parameters,
            "feature_values": int(model.features.size),
            "source": model.provenance.source,
            "hash": model.digest,
        }
        for model in known
    ]
    if plot:
        from viewsep.plots.contact_sheet import contact_sheet  # matplotlib is slow to import

        contact_sheet(known, plot)
        people.print(f"contact sheet: {plot}", soft_wrap=True)
    if json:
        print_json(rows)
        return
    name = Column("object", no_wrap=True)  # never cut, however narrow the terminal
    table = Table(name, "views", "edges", "values", "bytes", "descriptor", "hash", "learned from")
    for row in rows:
        table.add_row(
            str(row["name"]),
            *(f"{row[key]:,}" for key in ("views", "edges", "feature_values", "bytes")),
            str(row["descriptor"]),
            str(row["hash"])[:12],
            str(row["source"]),
        )
    results.print(table)


app.command("check")(check)
