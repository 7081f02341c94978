"""`viewsep replay` on golden recordings: from the middle, played, through other methods."""

from __future__ import annotations

from pathlib import Path

import pytest
from shell import Shell

GOLDEN = Path(__file__).parents[1] / "golden"
V1, V2 = GOLDEN / "v1.mcap", GOLDEN / "v2.mcap"


def test_a_replay_from_the_middle(shell: Shell) -> None:
    whole = shell("replay", V2, "--verify", "--json").json["decisions"]
    later = shell("replay", V2, "--verify", "--from", 9, "--json").json["decisions"]
    assert later["exact"] == whole["exact"]
    assert 0 < later["events"] < whole["events"]
    assert later["keyframes"] < whole["keyframes"] or not whole["exact"]
    none = shell("replay", V1, "--verify", "--from", 9)
    assert (none.code, "it has none" in none.err) == (2, True)


def test_a_recording_is_played(shell: Shell) -> None:
    played = shell("replay", V2, "--pace", 0)
    assert played.code == 0
    assert "It is product_7_twin_face" in played.out
    told = shell("replay", V2, "--pace", 0, "--json").json
    assert told["pictures"] == 66
    assert told["passes"] == 1


@pytest.mark.parametrize(
    ("typed", "says"),
    [
        (("--from", 3), "nothing to do"),
        (("--pace", 1, "--verify"), "play a recording, the other options check it"),
        (("--pace", 0, "--interpreter", "path"), "give the one or the other"),
        (("--from", 3, "--interpreter", "path"), "give the one or the other"),
        (("--name", "x"), "go with --publish"),
        (("--pace", -1), "pace"),
        (("--interpreter", "path:variant"), "path:variant"),
        (("--interpreter", "nobody"), "no interpreter is called 'nobody'"),
        (("--interpreter", "path", "--interpreter", "path"), "given twice"),
    ],
)
def test_options_that_do_not_go_together(shell: Shell, typed: tuple[str | int, ...], says: str) -> None:
    refused = shell("replay", V2, *typed)
    assert (refused.code, refused.out) == (2, "")
    assert says in refused.err


def test_two_recordings_cannot_be_played_at_once(shell: Shell) -> None:
    refused = shell("replay", V1, V2, "--pace", 0)
    assert refused.code == 2
    assert "2 recordings cannot be played at once" in refused.err


def test_other_methods_stand_beside_what_was_recorded(shell: Shell) -> None:
    methods = ("--interpreter", "path", "--interpreter", "path:variant=particles", "--interpreter", "filter")
    said = shell("replay", V1, V2, *methods, "--planner", "separating", "--json").json
    table = shell("replay", V1, V2, *methods, "--planner", "separating")
    assert table.code == 0
    assert "filter" in table.out
    assert len(said["recordings"]) == 2
    for recording in said["recordings"]:
        recorded, same, particles, posterior = recording["courses"]
        assert (same["object"], same["looks"]) == (recorded["object"], recorded["looks"])
        assert (particles["looks"], particles["comparisons"]) != (recorded["looks"], recorded["comparisons"])
        assert posterior["looks"] <= recorded["looks"]
