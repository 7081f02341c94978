"""Pictures from the cache are those of the renderer, whatever happens to the folder meanwhile."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from viewsep.config import Config, TaskConfig
from viewsep.errors import BadInput
from viewsep.geometry import random_rotation
from viewsep.learning import learn_object
from viewsep.messages import FloatArray
from viewsep.sim.render import CameraOptics, Renderer
from viewsep.sim.render_cache import SHELVES, Picture, RenderCache, _decoded, _encoded, picture_key
from viewsep.sim.source import open_renderer
from viewsep.task import Task, run_task

pytestmark = pytest.mark.needs_pybullet

CAMERA = np.array([1.0, 0.0, 0.0])

Open = Callable[..., Renderer]


def key(number: int, shelf: int = 0) -> str:
    return f"{shelf:08x}{number:056x}"


def pose(seed: int) -> FloatArray:
    return random_rotation(np.random.default_rng(seed))


def picture(seed: int, size: int = 16) -> Picture:
    rng = np.random.default_rng(seed)
    return rng.integers(0, 256, (size, size, 3), np.uint8), rng.random((size, size)) < 0.5


def assert_same(a: Picture | None, b: Picture | None) -> None:
    assert a is not None
    assert b is not None
    for one, other in zip(a, b, strict=True):
        assert (one.dtype, one.shape, one.flags.c_contiguous) == (other.dtype, other.shape, True)
        assert one.tobytes() == other.tobytes()


@pytest.fixture
def opened(product_mesh: Path) -> Iterator[Open]:
    """Opens renderers of the product: `opened(cache)`."""
    with ExitStack() as stack:

        def open_one(cache: RenderCache | None = None, size: int = 64) -> Renderer:
            renderer = open_renderer(str(product_mesh), CameraOptics(size), cache)
            stack.callback(renderer.close)
            return renderer

        yield open_one


@given(seed=st.integers(0, 2**32), size=st.integers(1, 40))
def test_what_is_kept_is_lossless(seed: int, size: int) -> None:
    assert_same(_decoded(_encoded(picture(seed, size))), picture(seed, size))


def test_pictures_from_the_cache_are_those_of_the_renderer_bit_for_bit(opened: Open, tmp_path: Path) -> None:
    cache, plain = RenderCache(tmp_path), opened()
    for renderer in (opened(cache), opened(cache)):
        for seed in range(5):
            assert_same(renderer.render(CAMERA, pose(seed)), plain.render(CAMERA, pose(seed)))
    assert len(list(tmp_path.glob("*/*.png"))) == 5


def test_what_is_in_the_cache_is_not_rendered_again(opened: Open, tmp_path: Path) -> None:
    cache = RenderCache(tmp_path)
    opened(cache).render(CAMERA, pose(1))
    (path,) = tmp_path.glob("*/*.png")
    path.write_bytes(_encoded(picture(7, 64)))  # so that the origin shows
    assert_same(opened(cache).render(CAMERA, pose(1)), picture(7, 64))


@pytest.mark.parametrize("source", ["generated:3", "product"])
def test_a_task_and_a_model_are_the_same_with_a_cache(source: str, product_mesh: Path, tmp_path: Path) -> None:
    source = str(product_mesh) if source == "product" else source
    config, cache = Config(task=TaskConfig(max_looks=20)), RenderCache(tmp_path)
    models = [learn_object(source, "a", 20, config, cache), learn_object(source, "b", 20, config)]
    assert learn_object(source, "a", 20, config).digest == models[0].digest
    plain = run_task(Task(source, "a", 5), config, models).as_dict()
    for _ in range(2):
        assert run_task(Task(source, "a", 5), config, models, cache=cache).as_dict() == plain


def test_everything_a_picture_depends_on_is_in_its_key() -> None:
    nearly = pose(1).copy()
    nearly[0, 0] = np.nextafter(nearly[0, 0], 2.0)
    keys = [
        picture_key("aa", CameraOptics(64), CAMERA, pose(1)),
        picture_key("ab", CameraOptics(64), CAMERA, pose(1)),
        picture_key("aa", CameraOptics(65), CAMERA, pose(1)),
        picture_key("aa", CameraOptics(64), -CAMERA, pose(1)),
        picture_key("aa", CameraOptics(64), CAMERA, nearly),
    ]
    assert len(set(keys)) == len(keys)
    assert picture_key("aa", CameraOptics(64), CAMERA.copy(), np.asfortranarray(pose(1))) == keys[0]


def test_the_least_recently_used_go_first_and_the_limit_holds(tmp_path: Path) -> None:
    size = len(_encoded(picture(0)))
    cache = RenderCache(tmp_path, limit_bytes=SHELVES * size * 4)
    for number in range(4):
        cache.put(key(number), picture(0))
        os.utime(next(tmp_path.glob(f"*/{key(number)}.png")), (number, number))
    assert cache.get(key(0)) is not None
    cache.put(key(4), picture(0))
    assert [cache.get(key(number)) is not None for number in range(6)] == [True, False, True, True, True, False]
    assert sum(path.stat().st_size for path in tmp_path.glob("*/*")) <= 4 * size


def test_a_picture_larger_than_its_share_is_kept_until_the_next(tmp_path: Path) -> None:
    cache = RenderCache(tmp_path, limit_bytes=1)
    for number in range(3):
        cache.put(key(number), picture(number))
        assert len(list(tmp_path.glob("*/*"))) == 1
    assert_same(cache.get(key(2)), picture(2))


@pytest.mark.parametrize("damage", ["empty", "cut", "flipped", "foreign"])
def test_a_damaged_file_is_rendered_again_and_replaced(damage: str, opened: Open, tmp_path: Path) -> None:
    cache = RenderCache(tmp_path)
    whole = opened(cache).render(CAMERA, pose(2))
    (path,) = tmp_path.glob("*/*.png")
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes({"empty": b"", "cut": bytes(data[:-9]), "flipped": bytes(data), "foreign": b"hello" * 9}[damage])
    assert_same(opened(cache).render(CAMERA, pose(2)), whole)
    assert_same(cache.get(path.stem), whole)


def test_a_folder_that_cannot_be_used_is_named_in_one_sentence(opened: Open, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("in the way")
    folder = tmp_path / "file" / "renders"
    with pytest.raises(BadInput, match=f"cannot use the render cache {folder}: Not a directory; choose another folder"):
        opened(RenderCache(folder)).render(CAMERA, pose(1))
    (tmp_path / "renders").mkdir()
    for shelf in range(SHELVES):
        (tmp_path / "renders" / f"{shelf:02x}").write_text("in the way")
    with pytest.raises(BadInput, match="cannot use the render cache"):
        RenderCache(tmp_path / "renders").put(key(0), picture(0))


def _fill(folder: Path, limit_bytes: int, first: int) -> None:
    """What one of several processes does: write and read the same keys in another order, room for half of them."""
    cache = RenderCache(folder, limit_bytes)
    for turn in range(4):
        for number in range(24):
            number = (number * (2 * first + 1) + turn) % 24
            found = cache.get(key(number, number % 2))
            if found is not None:
                assert_same(found, picture(number))
            cache.put(key(number, number % 2), picture(number))


def test_processes_that_write_the_same_keys_at_once_leave_each_other_alone(tmp_path: Path) -> None:
    limit = SHELVES * len(_encoded(picture(0))) * 6
    spawn = multiprocessing.get_context("spawn")
    processes = [spawn.Process(target=_fill, args=(tmp_path, limit, first)) for first in range(2)]
    for process in processes:
        process.start()
    for process in processes:
        process.join(60)
    assert [process.exitcode for process in processes] == [0, 0]
    kept = list(tmp_path.glob("*/*"))
    assert kept
    assert all(path.suffix == ".png" and _decoded(path.read_bytes()) is not None for path in kept)
    assert sum(path.stat().st_size for path in kept) <= limit / SHELVES * 2
