"""What a library's check says about painted objects whose differences are known."""

from __future__ import annotations

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from painted import DIMENSIONS, EDGES, NODES, POLE, TWIN, graph, model, noisy, painted, ring_model, unlearned
from shell import Shell

from viewsep.descriptors.cch import ColourCooccurrence
from viewsep.geometry import angle_between, axis_rotation, rotation_angle
from viewsep.interpretation.view_cells import CELLS, cell_areas, cell_directions
from viewsep.kinematics import preset
from viewsep.library_check.alignment import Candidates, aligned, alignments, bits_of, confusion_of
from viewsep.library_check.objects import TurnedPose, alone, why_again
from viewsep.library_check.pairs import (
    CONFUSED,
    LEAST_BITS,
    TELLING_BITS,
    OnRig,
    Pair,
    RigPoses,
    by_difficulty,
    pair_of,
    places_of,
)
from viewsep.library_check.words import object_in_words, pair_in_words, worth_saying
from viewsep.messages import BoolArray, FloatArray
from viewsep.models.aspect_graph import AspectGraph, Trials
from viewsep.models.library import save
from viewsep.planning.reachable import ReachableViews
from viewsep.trials import trial_directions

TURN = axis_rotation(np.array([0.6, 0.0, 0.8]), 2.0)
TWIN_CAP_RAD = np.radians(60.0)  # the twin differs within it, and hardly at its edge
PLAIN, TWINNED, TURNED, OTHER, DOUBLE = range(5)


def painted_graph(name: str, turn: FloatArray, *, halves: bool = False) -> AspectGraph:
    """The first painted object in a frame of its own; with `halves` it looks the same turned by half a turn about z."""

    def shown(directions: FloatArray) -> FloatArray:
        seen = directions @ turn
        once = np.asarray(painted(seen, 1), np.float64)
        return 0.5 * (once + painted(seen * [-1.0, -1.0, 1.0], 1)) if halves else once

    at = trial_directions(60)
    looks = noisy(shown(at), 0.1, 7)
    trials = Trials(at, looks, np.zeros(len(at), bool))
    return graph(name, NODES, EDGES, shown(NODES).astype(np.float32), trials)


@cache
def models() -> tuple[AspectGraph, ...]:
    return (
        model("plain", 1, noise=0.1, disturbed=0.3),
        model("twinned", 1, TWIN, noise=0.1, disturbed=0.3),
        painted_graph("turned", TURN),
        model("other", 2, noise=0.1, disturbed=0.3),
        painted_graph("double", np.eye(3), halves=True),
    )


@cache
def candidates() -> Candidates:
    return Candidates.of(models())


@cache
def found(first: int, second: int) -> Pair:
    return pair_of(candidates(), first, second, RigPoses(ReachableViews.of(preset("turntable"))))


# ---- what one look tells ----


def test_bits_go_from_nothing_to_one_and_confusion_from_a_half_to_nothing() -> None:
    bits = bits_of(candidates().predictions, np.array([0.0, 1.0, 10.0, 100.0, 1e6])).astype(float)
    assert bits[0] == 0.0
    assert bits[-1] == pytest.approx(1.0, abs=0.01)
    assert (np.diff(bits) > 0.0).all()
    confusion = confusion_of(bits)
    assert confusion[0] == pytest.approx(0.5)
    assert confusion_of(np.array([TELLING_BITS, 1.0])).tolist() == pytest.approx([CONFUSED, 0.0])


def test_areas_of_cells_are_those_of_the_sphere() -> None:
    assert cell_areas().sum() == pytest.approx(1.0)
    for cap_deg in (20.0, 60.0, 90.0, 140.0):
        within = angle_between(cell_directions(), np.array([0.48, 0.6, 0.64])) < np.radians(cap_deg)
        assert cell_areas()[within].sum() == pytest.approx(0.5 * (1.0 - np.cos(np.radians(cap_deg))), abs=0.004)


# ---- the pose in which two objects are most alike ----


def test_an_object_in_another_frame_is_found_to_be_the_same() -> None:
    pair = found(PLAIN, TURNED)
    assert pair.alignment is not None
    assert np.degrees(rotation_angle(pair.alignment.rotation, TURN)) < 3.0
    assert pair.best_bits < LEAST_BITS
    assert pair.telling == 0.0
    assert pair.furthest_rad == np.inf
    assert pair.on_rig == OnRig(told=0.0, hopeless=1.0)
    assert pair_in_words(pair).startswith("plain and turned cannot be told apart")


def test_a_twin_differs_where_it_was_painted_otherwise() -> None:
    pair = found(PLAIN, TWINNED)
    assert pair.alignment is not None
    assert np.degrees(rotation_angle(pair.alignment.rotation, np.eye(3))) < 3.0
    told = pair.alignment.bits >= TELLING_BITS
    away = angle_between(cell_directions(), POLE)
    assert told[away < 0.7 * TWIN_CAP_RAD].all()
    assert not told[away > 1.15 * TWIN_CAP_RAD].any()
    assert pair.best_bits > 0.99
    (place,) = pair.places
    assert np.degrees(angle_between(place.centre, POLE)) < 5.0
    assert 0.7 * TWIN_CAP_RAD < place.radius_rad < 1.15 * TWIN_CAP_RAD
    assert place.share == pytest.approx(pair.telling)
    assert place.share == pytest.approx(0.5 * (1.0 - np.cos(place.radius_rad)), abs=0.03)
    assert pair.furthest_rad == pytest.approx(np.pi - place.radius_rad, abs=0.15)
    assert np.degrees(angle_between(pair.best_views, POLE)).max() < 50.0
    said = pair_in_words(pair)
    assert "differ only within" in said
    assert f"from {100.0 * pair.telling:.0f} % of the views" in said


def test_a_turntable_shows_the_difference_where_its_ring_meets_it() -> None:
    """The pole may point anywhere; the ring at 25 degrees meets the cap around it where its height is close to that."""
    pair = found(PLAIN, TWINNED)
    assert pair.on_rig is not None
    (place,) = pair.places
    ring = np.radians(25.0)
    expected = 0.5 * (np.sin(min(ring + place.radius_rad, np.pi / 2)) - np.sin(ring - place.radius_rad))
    assert pair.on_rig.told == pytest.approx(expected, abs=0.06)
    assert pair.on_rig.hopeless <= 1.0 - pair.on_rig.told


def test_a_rig_that_shows_everything_tells_in_every_pose() -> None:
    pair = pair_of(candidates(), PLAIN, TWINNED, RigPoses(ReachableViews.of(preset("gimbal"))))
    assert pair.on_rig == OnRig(told=1.0, hopeless=0.0)


def test_different_objects_are_told_apart_from_anywhere() -> None:
    pair = found(PLAIN, OTHER)
    assert pair.telling > 0.97
    assert pair.furthest_rad < np.radians(20.0)
    assert pair_in_words(pair) == "plain and other are told apart by one look from anywhere."


def test_the_hardest_pair_comes_first() -> None:
    pairs = [found(PLAIN, OTHER), found(PLAIN, TWINNED), found(PLAIN, TURNED)]
    assert [pair.second for pair in by_difficulty(pairs)] == ["turned", "twinned", "other"]
    assert [pair.second for pair in worth_saying(by_difficulty(pairs))] == ["turned", "twinned"]


def test_models_of_a_ring_are_compared_where_both_have_views() -> None:
    rings = Candidates.of([ring_model("first", 1), ring_model("second", 1)])
    pair = pair_of(rings, 0, 1, None)
    assert pair.alignment is not None
    assert pair.best_bits < LEAST_BITS
    known = ~np.isnan(pair.alignment.bits)
    of_itself = ~np.isnan(aligned(rings, 0, 0, np.eye(3)).bits)
    assert known.sum() > 0.8 * of_itself.sum()
    assert not known[~of_itself].any()
    assert cell_areas()[known].sum() < 0.5


def test_models_without_common_views_cannot_be_compared() -> None:
    whole, sparse = model("whole", 1), ring_model("ring", 1)
    pair = pair_of(Candidates.of([whole, sparse]), 0, 1, None)
    assert pair.alignment is not None, "a ring lies on a whole sphere"
    never = replace(pair, alignment=None, bits=float("nan"))
    assert "cannot be compared" in pair_in_words(never)
    assert by_difficulty([never, pair])[-1] is never


def test_places_are_told_apart_and_the_larger_comes_first() -> None:
    def cap(axis: FloatArray, degrees: float) -> BoolArray:
        return np.asarray(angle_between(cell_directions(), axis) < np.radians(degrees))

    larger, smaller = places_of(cap(POLE, 40.0) | cap(-POLE, 25.0))
    assert np.degrees(angle_between(larger.centre, POLE)) < 2.0
    assert np.degrees(angle_between(smaller.centre, -POLE)) < 2.0
    assert larger.share == pytest.approx(0.117, abs=0.01)
    assert smaller.share == pytest.approx(0.047, abs=0.01)
    assert np.degrees(larger.radius_rad) == pytest.approx(39.0, abs=2.0)
    assert places_of(np.zeros(CELLS, bool)) == ()


# ---- models alone ----


def test_half_a_turn_that_changes_nothing_is_found() -> None:
    one = alone(candidates(), DOUBLE)
    assert one.turned is not None
    assert one.turned.alike
    assert np.degrees(one.turned.angle_rad) == pytest.approx(180.0, abs=4.0)
    assert abs(float(np.array(one.turned.axis) @ POLE)) > np.cos(np.radians(4.0))
    assert one.turned.telling == 0.0
    assert "looks nearly the same turned by" in object_in_words(one)


def test_an_object_without_symmetry_has_none() -> None:
    one = alone(candidates(), PLAIN)
    assert one.turned is None or not one.turned.alike
    assert object_in_words(one) == ""
    assert (one.views, one.trials, one.again) == (100, 120, "")
    assert one.covered == pytest.approx(1.0)


def test_a_turned_pose_is_that_of_its_alignment() -> None:
    turned = TurnedPose.of(aligned(candidates(), DOUBLE, DOUBLE, axis_rotation(POLE, np.pi)))
    assert turned.bits < LEAST_BITS
    assert turned.axis == pytest.approx((0.0, 0.0, 1.0))
    assert alignments(candidates(), DOUBLE, DOUBLE)[0].mean < LEAST_BITS


def test_models_of_a_ring_cover_a_part() -> None:
    one = alone(Candidates.of([ring_model("first", 1), ring_model("second", 2)]), 0)
    assert 0.05 < one.covered < 0.5
    assert one.again == "it has no trials to learn the likelihood from"


def test_where_it_was_not_learned_its_look_alike_is_named() -> None:
    gapped = unlearned(models()[TWINNED], -POLE, 50.0, TURN)
    library = Candidates.of([models()[PLAIN], gapped, models()[OTHER]])
    one = alone(library, 1)
    assert [name for name, _ in one.lent] == ["plain"]
    assert one.lent[0][1] == pytest.approx(1.0 - one.covered, abs=0.01)
    assert object_in_words(one).startswith("twinned was not learned from 13 % of all sides where plain was, and is")
    for whole in (0, 2):
        assert alone(library, whole).lent == ()


# ---- the command ----


def storable(one: AspectGraph) -> AspectGraph:
    """With features as long as the descriptor's."""
    descriptor = ColourCooccurrence()

    def wide(features: FloatArray) -> FloatArray:
        return np.pad(features, ((0, 0), (0, descriptor.size - DIMENSIONS))).astype(np.float32)

    assert one.trials is not None
    trials = replace(one.trials, features=wide(one.trials.features))
    return replace(one, features=wide(one.features), trials=trials, descriptor_parameters=descriptor.parameters)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    library = tmp_path_factory.mktemp("check") / "library"
    for which in (PLAIN, TWINNED, OTHER):
        save(storable(models()[which]), library)
    return library


@pytest.fixture(scope="module")
def rig(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("rig") / "rig.toml"
    path.write_text('[rig]\npreset = "turntable"\n[descriptor]\nname = "cch"\n')
    return path


def test_the_command_ranks_pairs_and_draws(shell: Shell, folder: Path, rig: Path, tmp_path: Path) -> None:
    ended = shell("models", "check", folder, "--config", rig, "--json", "--plot", tmp_path / "pictures")
    assert ended.code == 0
    first, *rest = ended.json["pairs"]
    assert {first["first"], first["second"]} == {"plain", "twinned"}
    assert 0.1 < first["telling_share"] < 0.35
    assert first["told_on_rig"] < 1.0
    assert all(pair["bits"] > 0.9 for pair in rest)
    assert [one["name"] for one in ended.json["objects"]] == ["other", "plain", "twinned"]
    assert [one["expected_to_look_like"] for one in ended.json["objects"]] == [[], [], []]
    drawn = sorted(path.name for path in (tmp_path / "pictures").iterdir())
    assert drawn[:2] == ["1_plain_twinned.png", "2_other_plain.png"]
    assert "confusion.png" in drawn
    assert all(path.read_bytes().startswith(b"\x89PNG") for path in (tmp_path / "pictures").iterdir())


def test_pairs_that_are_too_hard_fail(shell: Shell, folder: Path, rig: Path) -> None:
    harder = shell("models", "check", folder, "--config", rig, "--fail-below", "0.5")
    assert harder.code == 1
    assert "1 of 3 pairs are harder than 0.5 bits a look, the hardest: plain and twinned" in harder.err
    assert "plain and twinned differ only within" in harder.out
    assert shell("models", "check", folder, "--config", rig, "--fail-below", "0.1").code == 0


def test_models_of_another_descriptor_must_be_learned_again(shell: Shell, folder: Path) -> None:
    ended = shell("models", "check", folder)
    assert ended.code == 2
    assert "no model in" in ended.err
    assert "learn the objects again" in ended.err
    assert why_again(replace(models()[PLAIN], descriptor="rings"), ColourCooccurrence()).endswith("rings, not cch")
    short = replace(models()[PLAIN], descriptor_parameters=ColourCooccurrence().parameters)
    assert "24 numbers" in why_again(short, ColourCooccurrence())


def test_the_list_is_what_models_does_without_a_command(shell: Shell, folder: Path) -> None:
    assert shell("models", folder).out == shell("models", "list", folder).out
    assert shell("models").code == 2
