"""Groups that do one of their commands when none is named."""

from __future__ import annotations

from typing import Any

from typer.core import TyperGroup


class DefaultsToFirst(TyperGroup):
    """What neither begins with a command nor asks for help is for the command that was added first."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """With the first command's name in front where it is left out."""
        if not args or args[0] not in (*self.commands, *ctx.help_option_names):
            args = [next(iter(self.commands)), *args]
        return super().parse_args(ctx, args)

    def list_commands(self, ctx: Any) -> list[str]:
        """In the order in which they were added."""
        return list(self.commands)
