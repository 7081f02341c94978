"""Single values are changed in a configuration file, and nothing else."""

from __future__ import annotations

from pathlib import Path

import pytest

from viewsep.cli.rig_init import configuration
from viewsep.config import load_config
from viewsep.config_file import set_bus, set_servo
from viewsep.errors import BadConfig


@pytest.mark.parametrize("newline", ["\n", "\r\n"])
def test_one_line_changes_and_the_file_before_is_kept(tmp_path: Path, newline: str) -> None:
    file = tmp_path / "rig.toml"
    before = configuration("wrist", "emulated", 57600).replace("\n", newline).encode()
    file.write_bytes(before)
    kept = set_servo(file, 1, "zero_counts", 1234)
    assert kept.read_bytes() == before
    lines = zip(before.splitlines(True), file.read_bytes().splitlines(True), strict=True)
    ((old, new),) = [(old, new) for old, new in lines if old != new]
    assert new == old.replace(b"2048 ", b"1234 ")
    assert [servo.zero_counts for servo in load_config(file).dynamixel.servos] == [2048, 1234, 2048]


def test_what_does_not_load_is_not_written(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(configuration("turntable", "emulated", 57600))
    before = file.read_bytes()
    with pytest.raises(BadConfig, match=r"settle_within_deg"):
        set_bus(file, "settle_within_deg", 99.0)
    assert file.read_bytes() == before
    assert list(tmp_path.iterdir()) == [file]


def test_a_link_stays_a_link_and_copies_are_never_replaced(tmp_path: Path) -> None:
    file, link = tmp_path / "rig.toml", tmp_path / "link.toml"
    file.write_text(configuration("turntable", "emulated", 57600))
    link.symlink_to(file)
    kept = {set_bus(link, "settle_within_deg", value) for value in (0.6, 0.7, 0.8)}
    assert link.is_symlink()
    assert load_config(file).dynamixel.settle_within_deg == 0.8
    assert sorted(load_config(copy).dynamixel.settle_within_deg for copy in kept) == [0.5, 0.6, 0.7]


def test_access_rights_stay(tmp_path: Path) -> None:
    file = tmp_path / "rig.toml"
    file.write_text(configuration("turntable", "emulated", 57600))
    file.chmod(0o600)
    set_bus(file, "settle_within_deg", 1.0)
    assert file.stat().st_mode & 0o777 == 0o600
