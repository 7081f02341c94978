"""Generated products: reproducible, sound boxes; twins differ from the plain product by exactly what they say."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from viewsep.errors import BadInput
from viewsep.messages import Array, FloatArray
from viewsep.sim.mesh import check_mesh
from viewsep.sim.products import TILE_PX, ProductSpec, parse_product, write_product

SEEDS = range(8)
FILES = ("textured.obj", "textured.mtl", "texture_map.png")


def texture(spec: ProductSpec, folder: Path) -> Array:
    picture = cv2.imread(str(check_mesh(write_product(spec, folder / spec.name)).texture))
    assert picture is not None
    return picture


def changed(spec: ProductSpec, folder: Path) -> dict[int, Array]:
    """Per tile that differs between the product and its twin `spec`: the mask (TILE_PX, TILE_PX) of what differs."""
    differs = (texture(ProductSpec(spec.seed), folder) != texture(spec, folder)).any(axis=2)
    tiles = differs.reshape(2, TILE_PX, 3, TILE_PX).swapaxes(1, 2).reshape(6, TILE_PX, TILE_PX)
    return {index: tile for index, tile in enumerate(tiles) if tile.any()}


@pytest.mark.parametrize(
    ("text", "spec", "name"),
    [
        ("generated:7", ProductSpec(7), "product_7"),
        ("generated:0:twin=face", ProductSpec(0, "face"), "product_0_twin_face"),
        ("generated:7:twin=none", ProductSpec(7, "none"), "product_7_twin_none"),
        ("generated:7:twin=sticker", ProductSpec(7, "sticker", 0.06), "product_7_twin_sticker"),
        ("generated:7:twin=sticker:sticker=0.1", ProductSpec(7, "sticker", 0.1), "product_7_twin_sticker"),
        ("generated:999999999", ProductSpec(999999999), "product_999999999"),
    ],
)
def test_products_are_named_and_parsed(text: str, spec: ProductSpec, name: str) -> None:
    assert parse_product(text) == spec
    assert spec.name == name


@pytest.mark.parametrize(
    "text",
    [
        "",
        "7",
        "generated",
        "generated:",
        "generated:x",
        "generated:-1",
        "generated:1.5",
        "generated:1234567890",
        "generated:7:",
        "generated:7:twin=lid",
        "generated:7:sticker=0.1:twin=sticker",
        "generated:7:twin=sticker:sticker=big",
        "generated:7:twin=sticker:sticker=",
        "generated:7:twin=sticker:sticker=nan",
        "generated:7:twin=face:colour=red",
        " generated:7",
        "generated:7\n",
    ],
)
def test_what_is_no_product_is_refused_with_an_example(text: str) -> None:
    with pytest.raises(BadInput, match=r"is not a generated product .* write for example generated:7:twin=sticker"):
        parse_product(text)


@pytest.mark.parametrize("share", ["0", "0.001", "0.51", "6"])
def test_a_sticker_of_absurd_size_is_refused(share: str) -> None:
    with pytest.raises(BadInput, match=f"sticker={share} is no share of a face from 0.005 to 0.5"):
        parse_product(f"generated:7:twin=sticker:sticker={share}")


def test_a_share_without_a_sticker_is_refused() -> None:
    with pytest.raises(BadInput, match=r"write generated:7:twin=sticker:sticker=0\.1"):
        parse_product("generated:7:twin=face:sticker=0.1")


def test_a_spec_checks_itself() -> None:
    with pytest.raises(BadInput, match="seed -1 is out of range"):
        ProductSpec(-1)
    with pytest.raises(BadInput, match="twin 'lid' is unknown; take face, sticker or none"):
        ProductSpec(1, "lid")
    with pytest.raises(BadInput, match="sticker=nan"):
        ProductSpec(1, "sticker", float("nan"))


@pytest.mark.parametrize("twin", [None, "face", "sticker", "none"])
def test_the_same_spec_gives_the_same_bytes(tmp_path: Path, twin: str | None) -> None:
    for name in ("one", "two", "two"):  # the second time over what is there
        path = write_product(ProductSpec(5, twin), tmp_path / name / "deep")
        assert sorted(file.name for file in path.parent.iterdir()) == sorted(FILES)
    for file in FILES:
        assert (tmp_path / "one/deep" / file).read_bytes() == (tmp_path / "two/deep" / file).read_bytes()


def test_seeds_give_different_products(tmp_path: Path) -> None:
    digests = {check_mesh(write_product(ProductSpec(seed), tmp_path / str(seed))).digest for seed in SEEDS}
    assert len(digests) == len(SEEDS)


def test_a_copy_is_the_product(tmp_path: Path) -> None:
    plain, copy = (check_mesh(write_product(ProductSpec(3, twin), tmp_path / str(twin))) for twin in (None, "none"))
    assert plain.digest == copy.digest


@pytest.mark.parametrize("seed", SEEDS)
def test_a_face_twin_differs_clearly_in_one_face_that_is_not_the_front(tmp_path: Path, seed: int) -> None:
    tiles = changed(ProductSpec(seed, "face"), tmp_path)
    assert len(tiles) == 1
    assert 0 not in tiles
    assert next(iter(tiles.values())).mean() > 0.6


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("share", [0.01, 0.06, 0.5])
def test_a_sticker_covers_its_share_of_one_upright_face(tmp_path: Path, seed: int, share: float) -> None:
    tiles = changed(ProductSpec(seed, "sticker", share), tmp_path)
    assert len(tiles) == 1
    index, mask = next(iter(tiles.items()))
    rows, columns = np.nonzero(mask)
    assert index < 4
    assert (np.ptp(rows) + 1) * (np.ptp(columns) + 1) / mask.size == pytest.approx(share, rel=0.08)


@pytest.mark.parametrize("seed", SEEDS)
def test_twins_have_the_same_box(tmp_path: Path, seed: int) -> None:
    shapes = {
        write_product(ProductSpec(seed, twin), tmp_path / str(twin)).read_text() for twin in (None, "face", "sticker")
    }
    assert len(shapes) == 1


def triangles(path: Path) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Corners (T, 3, 3) in metres, texture coordinates (T, 3, 2) and normals (T, 3) of a generated box."""
    rows = [line.split() for line in path.read_text().splitlines()]
    points, coordinates, normals = (
        np.array([row[1:] for row in rows if row[0] == word], np.float64) for word in ("v", "vt", "vn")
    )
    corners = np.array([[corner.split("/") for corner in row[1:]] for row in rows if row[0] == "f"], np.int64) - 1
    return points[corners[..., 0]], coordinates[corners[..., 1]], normals[corners[:, 0, 2]]


@pytest.mark.parametrize("seed", SEEDS)
def test_the_box_is_a_retail_box_that_faces_outwards(tmp_path: Path, seed: int) -> None:
    path = write_product(ProductSpec(seed), tmp_path)
    corners, _, normals = triangles(path)
    width, depth, height = np.ptp(corners.reshape(-1, 3), axis=0)
    assert 0.055 < depth < 0.1
    assert width > 1.45 * depth
    assert max(width, height) < 0.225
    wound = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    outwards = corners.mean(axis=1) - np.array(check_mesh(path).centre_m)
    assert (np.einsum("ij,ij->i", wound, normals) > 0).all()
    assert (np.einsum("ij,ij->i", outwards, normals) > 0).all()
    assert np.linalg.norm(wound, axis=1).sum() / 2 == pytest.approx(
        2 * (width * depth + depth * height + height * width), rel=1e-3
    )


def test_print_is_not_mirrored_and_stays_in_its_tile(tmp_path: Path) -> None:
    _, coordinates, _ = triangles(write_product(ProductSpec(2), tmp_path))
    first, second = coordinates[:, 1] - coordinates[:, 0], coordinates[:, 2] - coordinates[:, 0]
    assert (first[:, 0] * second[:, 1] > first[:, 1] * second[:, 0]).all()  # counter-clockwise on the print as well
    tiles = np.floor(coordinates * [3, 2])
    assert (tiles == tiles[:, :1]).all()


def test_the_faces_of_a_box_all_differ(tmp_path: Path) -> None:
    picture = texture(ProductSpec(4), tmp_path).astype(np.float64)
    tiles = picture.reshape(2, TILE_PX, 3, TILE_PX, 3).swapaxes(1, 2).reshape(6, -1)
    distances = np.abs(tiles[:, None] - tiles[None]).mean(axis=2)
    assert (distances[~np.eye(6, dtype=bool)] > 20).all()


def test_a_folder_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(BadInput, match=r"file: cannot write product_1 \(File exists\); name a folder"):
        write_product(ProductSpec(1), tmp_path / "file")
