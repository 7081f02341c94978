"""`viewsep recordings recover`."""

from __future__ import annotations

from pathlib import Path

from shell import Shell

from viewsep.recordings.codec import PICTURES, SCHEMAS
from viewsep.recordings.reader import read_recording

GOLDEN = Path(__file__).parents[1] / "golden" / "v2.mcap"


def test_what_is_left_is_saved_and_told(shell: Shell, tmp_path: Path) -> None:
    part = tmp_path / "run.mcap.part"
    part.write_bytes(GOLDEN.read_bytes()[:-200_000])
    ended = shell("recordings", "recover", part)
    assert (ended.code, ended.err) == (0, "")
    assert "messages over" in ended.out
    assert f"saved in {tmp_path / 'run.recovered.mcap'}" in ended.out
    assert "lost: bytes" in ended.out
    kept = len(read_recording(tmp_path / "run.recovered.mcap").messages)
    again = shell("recordings", "recover", part, "--json")
    (said,) = again.json
    assert said["already"]
    assert said["path"] == str(tmp_path / "run.recovered.mcap")
    ours = SCHEMAS.keys() - set(PICTURES)
    assert sum(count for topic, count in said["messages"].items() if topic in ours) == kept
    assert said["lost"][0]["what"] == "chunk"


def test_whole_files_and_lost_ones(shell: Shell, tmp_path: Path) -> None:
    ended = shell("recordings", "recover", GOLDEN)
    assert (ended.code, ended.out.strip()) == (0, f"{GOLDEN} is whole: nothing to recover")
    assert shell("recordings", "recover", GOLDEN, "--json").json == [{"source": str(GOLDEN), "whole": True}]
    (tmp_path / "empty.mcap").write_bytes(b"")
    for file, says in ((tmp_path / "none.mcap", "no such file"), (tmp_path / "empty.mcap", "there is nothing to save")):
        refused = shell("recordings", "recover", file)
        assert (refused.code, refused.out) == (2, "")
        assert str(file) in refused.err
        assert says in refused.err
    assert [path.name for path in tmp_path.iterdir()] == ["empty.mcap"]
