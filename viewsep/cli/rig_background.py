"""`viewsep rig background`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from viewsep.calibration.compensation import compensated
from viewsep.capture.empty import capture_empty
from viewsep.cli.console import MAX_SEED, people, print_json, progress_bar
from viewsep.cli.rig_interrupt import interrupt_noted, unless
from viewsep.cli.service_options import Json
from viewsep.config import Config, geometry_of, load_config
from viewsep.errors import BadInput
from viewsep.perception.background import learn_background
from viewsep.perception.empty_rig import EmptyPicture
from viewsep.perception.holder import learn_holder
from viewsep.perception.plain import PlainBackdrop
from viewsep.perception.stored import save_background, save_holder
from viewsep.rigs import empty_rig

FOUND, NONE = "found", "none"


def background(
    config: Annotated[Path, typer.Option("--config", "-c", help="The rig's configuration.", show_default=False)],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", help="File for the background.", show_default="perception.background"),
    ] = None,
    holder: Annotated[
        Path | None,
        typer.Option(help="File for the masks of a holder that is seen before a plain backdrop.", show_default="none"),
    ] = None,
    joints: Annotated[
        str,
        typer.Option(
            help="Joints that show in the picture, comma-separated; 'none', or 'found': each is turned to see it."
        ),
    ] = FOUND,
    every_deg: Annotated[float, typer.Option(min=0.5, max=90.0, help="Between pictures of a joint that shows.")] = 3.0,
    seed: Annotated[int, typer.Option(min=0, max=MAX_SEED, help="Seed of a staged camera's light and noise.")] = 0,
    force: Annotated[bool, typer.Option(help="Replace existing files.")] = False,
    json: Json = False,
) -> None:
    """Capture the empty rig, so that objects are found before it: drive it through its joint angles and take pictures.

    Take the object out first. The file is what `perception.background` names, with perception.method = "background";
    that of --holder is what `perception.holder` names, with "plain". Changed light or a moved camera need new ones.

    Exit codes: 0 written, 1 the rig fails, 2 bad input, 130 interrupted.

    Examples:

        viewsep rig background -c rig.toml -o background.npz

        viewsep rig background -c rig.toml -o background.npz --joints none --force

        viewsep rig background -c rig.toml --holder holder.npz --joints pan
    """
    settings = load_config(config)
    files = _Files.of(settings, output, holder, force)
    chosen = _indices(joints, [limit.name for limit in geometry_of(settings.rig).limits])
    built = empty_rig(settings, seed)
    with interrupt_noted() as ended, progress_bar() as bar:
        task = bar.add_task("capturing the empty rig", total=None)
        empty = capture_empty(
            compensated(built.rig, settings),
            chosen,
            float(np.radians(every_deg)),
            lambda count: bar.update(task, total=count),
            lambda: bar.advance(task),
            unless(ended, "stopped; nothing is saved"),
        )
        files.write(empty.pictures)
    names = [limit.name for limit in built.rig.geometry.limits]
    showing = [names[joint] for joint in empty.joints]
    if json:
        print_json(
            {
                "background": None if files.background is None else str(files.background),
                "holder": None if files.holder is None else str(files.holder),
                "pictures": len(empty.pictures),
                "joints": showing,
                "every_deg": every_deg,
                "rig": built.described,
            }
        )
        return
    seen = f"{' and '.join(showing)} shows in it" if showing else "no joint shows in it"
    written = ", ".join(str(path) for path in (files.background, files.holder) if path is not None)
    people.print(
        f"captured the empty rig ({built.described}) in {len(empty.pictures)} pictures; {seen} -> {written}",
        soft_wrap=True,
        highlight=False,
    )


class _Files:
    """What is to be written."""

    def __init__(self, background: Path | None, holder: Path | None) -> None:
        self.background, self.holder = background, holder

    @staticmethod
    def of(config: Config, output: Path | None, holder: Path | None, force: bool) -> _Files:
        """Raises BadInput when there is nothing to write, or it is there already."""
        named = config.perception.background
        background = output or (Path(named) if named and holder is None else None)
        if background is None and holder is None:
            raise BadInput("there is nothing to write: give -o FILE, --holder FILE, or the key perception.background")
        for path in (background, holder):
            if path is not None and path.exists() and not force:
                raise BadInput(f"{path} exists: choose another name, or --force to replace it")
            if path is not None and path.suffix.lower() != ".npz":
                raise BadInput(f"{path}: end its name with .npz")
        return _Files(background, holder)

    def write(self, pictures: list[EmptyPicture]) -> None:
        """Learn and write. Raises BadInput."""
        background = None if self.background is None else learn_background(pictures)
        holder = None if self.holder is None else learn_holder(pictures, PlainBackdrop())
        if self.background is not None and background is not None:
            save_background(background, self.background)
        if self.holder is not None and holder is not None:
            save_holder(holder, self.holder)


def _indices(joints: str, names: list[str]) -> list[int] | None:
    """Which joints are meant; None for those that are found. Raises BadInput."""
    if joints == FOUND:
        return None
    wanted = [] if joints == NONE else [name.strip() for name in joints.split(",")]
    unknown = [name for name in wanted if name not in names]
    if unknown:
        raise BadInput(
            f"--joints {unknown[0]!r}: the rig has {', '.join(names)}; name some of them, '{FOUND}' or '{NONE}'"
        )
    return [index for index, name in enumerate(names) if name in wanted]
