"""Meshes that pybullet would render white, wrong or crash on are refused in one clear sentence; good ones pass."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from viewsep.errors import BadMesh
from viewsep.sim.mesh import check_mesh, find_mesh
from viewsep.sim.products import ProductSpec, write_product

SHARED = Path(__file__).parents[2].parent / "shared" / "objects"
PICTURE = np.full((8, 8, 3), 120, np.uint8)

Break = Callable[[Path], object]
"""Spoils one thing about the good product in a folder."""


@pytest.fixture(scope="session")
def good_product(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_product(ProductSpec(1), tmp_path_factory.mktemp("good")).parent


@pytest.fixture
def folder(good_product: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(good_product, tmp_path / "product"))


def swap(name: str, old: str, new: str, count: int = 1) -> Break:
    def spoil(folder: Path) -> None:
        text = (folder / name).read_text()
        assert old in text
        (folder / name).write_text(text.replace(old, new, count))

    return spoil


def without(name: str, word: str) -> Break:
    def spoil(folder: Path) -> None:
        lines = (folder / name).read_text().splitlines()
        (folder / name).write_text("\n".join(line for line in lines if line.split()[0] != word))

    return spoil


def scaled(factor: float) -> Break:
    def spoil(folder: Path) -> None:
        path = folder / "textured.obj"
        rows = [line.split() for line in path.read_text().splitlines()]
        path.write_text(
            "\n".join(
                " ".join([row[0], *(str(factor * float(n)) for n in row[1:])] if row[0] == "v" else row) for row in rows
            )
        )

    return spoil


def holding(name: str, data: bytes) -> Break:
    return lambda folder: (folder / name).write_bytes(data)


def encoded(extension: str, picture: np.ndarray = PICTURE, *options: int) -> bytes:
    return cv2.imencode(extension, picture, options)[1].tobytes()


def cmyk(jpeg: bytes) -> bytes:
    at = jpeg.index(b"\xff\xc0")
    return jpeg[: at + 9] + b"\4" + jpeg[at + 10 :]


OBJ, MTL, PNG = "textured.obj", "textured.mtl", "texture_map.png"

BROKEN: dict[str, tuple[Break, str]] = {
    "no file": (lambda folder: (folder / OBJ).unlink(), r"textured\.obj: the mesh cannot be read \(No such file"),
    "binary": (holding(OBJ, b"glTF\2\0\0\0"), "is not a text file"),
    "empty": (holding(OBJ, b""), "has no vertices"),
    "no vertices": (without(OBJ, "v"), "has no vertices"),
    "no faces": (without(OBJ, "f"), "has no faces .* point cloud"),
    "nan": (
        swap(OBJ, "usemtl print\nv ", "usemtl print\nv nan "),
        r"line 3: 'nan' in 'v nan .*' is not a finite number",
    ),
    "infinite": (
        swap(OBJ, "usemtl print\nv ", "usemtl print\nv 1e999 "),
        "line 3: '1e999' in .* is not a finite number",
    ),
    "comma": (swap(OBJ, "print\nv -0.", "print\nv -0,"), "line 3: '-0,[0-9]+' in .* is not a number"),
    "short vertex": (swap(OBJ, "print\n", "print\nv 1 2\n"), "line 3: 'v 1 2' has 2 of 3 numbers"),
    "empty vertex": (swap(OBJ, "print\n", "print\nv\n"), "line 3: 'v ' has 0 of 3 numbers"),
    "bad texture coordinate": (swap(OBJ, "vt 0.", "vt O."), r"line \d+: 'O\.[0-9]+' in 'vt .*' is not a number"),
    "vertex out of range": (swap(OBJ, "f 1/1/1", "f 487/1/1"), "'487/1/1' asks for vertex 487, but there are 486"),
    "vertex zero": (swap(OBJ, "f 1/1/1", "f 0/1/1"), "'0/1/1' asks for vertex 0"),
    "vertex too far back": (swap(OBJ, "f 1/1/1", "f -487/1/1"), "asks for vertex -487"),
    "coordinate out of range": (swap(OBJ, "f 1/1/1", "f 1/9999/1"), "asks for texture coordinate 9999, but there"),
    "normal out of range": (swap(OBJ, "f 1/1/1", "f 1/1/7"), "asks for normal 7, but there are 6"),
    "enormous index": (swap(OBJ, "f 1/1/1", f"f {10**30}/1/1"), "asks for vertex 1000000000"),
    "index not whole": (swap(OBJ, "f 1/1/1", "f 1.5/1/1"), "face index '1.5' in '1.5/1/1' is not a whole number"),
    "four indices": (swap(OBJ, "f 1/1/1", "f 1/1/1/1"), "'1/1/1/1' is not vertex/texture"),
    "two corners": (swap(OBJ, "f 1/1/1", "f 1/1/1 2/2/1\nf 1/1/1"), "'f 1/1/1 2/2/1' has 2 corners"),
    "no texture coordinate": (swap(OBJ, "f 1/1/1", "f 1//1"), "corner '1//1' has no texture coordinate"),
    "vertices only": (swap(OBJ, "f 1/1/1", "f 1"), "corner '1' has no texture coordinate"),
    "no mtllib": (without(OBJ, "mtllib"), "has no 'mtllib' line"),
    "mtllib of nothing": (
        swap(OBJ, "mtllib textured.mtl", "mtllib"),
        "'mtllib ' names a material file that is missing",
    ),
    "no material file": (lambda folder: (folder / MTL).unlink(), r"material file that is missing \(.*textured\.mtl\)"),
    "material file is binary": (holding(MTL, b"\0\1\2"), r"textured\.mtl: is not a text file"),
    "blank in mtllib": (
        lambda folder: [(folder / MTL).rename(folder / "my print.mtl"), swap(OBJ, MTL, "my print.mtl")(folder)],
        "'mtllib my print.mtl' names a material file that is missing .* without blanks",
    ),
    "no usemtl": (without(OBJ, "usemtl"), "has no 'usemtl' line"),
    "two materials": (swap(OBJ, "f 1/1/1", "usemtl lid\nf 1/1/1"), r"uses 2 materials \(print, lid\).* one texture"),
    "unknown material": (swap(MTL, "newmtl print", "newmtl lid"), r"no material 'print' .*\(it has: lid\)"),
    "no material": (without(MTL, "newmtl"), r"no material 'print' .*\(it has: none\)"),
    "no map": (without(MTL, "map_Kd"), "material 'print' has no 'map_Kd' texture"),
    "map of another": (swap(MTL, "map_Kd", "newmtl lid\nmap_Kd"), "material 'print' has no 'map_Kd' texture"),
    "no texture": (lambda folder: (folder / PNG).unlink(), r"map_Kd texture_map\.png' names a texture that is missing"),
    "map options": (swap(MTL, "map_Kd", "map_Kd -s 1 1 1"), "texture that is missing .* without options"),
    "two blanks": (swap(MTL, "map_Kd", "map_Kd "), "texture that is missing .* after one blank"),
    "absolute texture": (
        lambda folder: swap(MTL, PNG, str(folder / PNG))(folder),
        "texture that is missing .* in the OBJ's folder",
    ),
    "webp": (holding(PNG, encoded(".webp")), "the texture is WebP, which renders white; save it as .* PNG"),
    "bmp": (holding(PNG, encoded(".bmp")), "the texture is neither PNG nor JPEG by its content"),
    "empty texture": (holding(PNG, b""), "the texture is neither PNG nor JPEG"),
    "16 bits": (holding(PNG, encoded(".png", PICTURE.astype(np.uint16))), "a PNG with 16 instead of 8 bits"),
    "progressive": (
        holding(PNG, encoded(".jpg", PICTURE, cv2.IMWRITE_JPEG_PROGRESSIVE, 1)),
        "the texture is a progressive .* JPEG, which renders white",
    ),
    "cmyk": (holding(PNG, cmyk(encoded(".jpg"))), "a JPEG that is neither RGB nor grey"),
    "truncated texture": (holding(PNG, encoded(".png")[:30]), "the texture is damaged and does not decode"),
    "absurd dimensions": (
        holding(PNG, encoded(".png").replace(b"IHDR\0\0\0\x08\0\0\0\x08", b"IHDR\0\1\0\0\0\1\0\0")),
        "the texture is damaged and does not decode",
    ),
    "millimetres": (scaled(1000), r"is \d+.* x .* m large, but sizes in metres between 0.001 and 10 are expected"),
    "specks": (scaled(0.001), r"m large, but sizes in metres .* are expected"),
}


@pytest.mark.parametrize(("spoil", "message"), BROKEN.values(), ids=BROKEN.keys())
def test_a_broken_mesh_is_refused_in_one_sentence(folder: Path, spoil: Break, message: str) -> None:
    check_mesh(folder / OBJ)
    spoil(folder)
    with pytest.raises(BadMesh, match=message) as refusal:
        check_mesh(folder / OBJ)
    assert str(refusal.value).startswith(str(folder))
    assert "\n" not in str(refusal.value)


ACCEPTED: dict[str, Break] = {
    "windows line ends": lambda folder: [swap(name, "\n", "\r\n", -1)(folder) for name in (OBJ, MTL)],
    "tabs": swap(OBJ, "f ", "f\t", -1),
    "indices from the end": swap(OBJ, "f 1/1/1", "f -486/-486/-6"),
    "mixed corner styles": swap(OBJ, "f 1/1/1", "f 1/1"),
    "a quad": swap(OBJ, "f 1/1/1 2/2/1 11/11/1\nf 1/1/1 11/11/1 10/10/1", "f 1/1 2/2 11/11 10/10\nf 1/1 2/2 11/11"),
    "vertex colours": swap(OBJ, "print\nv", "print\nv 0 0 0 0.5 0.5 0.5\nv"),
    "normals of degenerate faces": swap(OBJ, "vn 0 -1 0", "vn nan nan nan"),
    "a comment in latin 1": lambda folder: (folder / OBJ).write_bytes(b"# Gr\xfc\xdfe\n" + (folder / OBJ).read_bytes()),
    "a material named twice": swap(OBJ, "f 1/1/1", "usemtl print\nf 1/1/1"),
    "an unused material": swap(MTL, "newmtl print", "newmtl lid\nmap_Kd lid.png\nnewmtl print"),
    "a jpeg by content": holding(PNG, encoded(".jpg")),
    "a grey texture": holding(PNG, encoded(".png", PICTURE[..., 0])),
    "a texture named with a blank": lambda folder: [
        (folder / PNG).rename(folder / "my print.png"),
        swap(MTL, PNG, "my print.png")(folder),
    ],
    "blanks at the end": swap(MTL, PNG, PNG + "  "),
}


@pytest.mark.parametrize("change", ACCEPTED.values(), ids=ACCEPTED.keys())
def test_what_pybullet_renders_is_accepted(folder: Path, change: Break) -> None:
    change(folder)
    mesh = check_mesh(folder / OBJ)
    assert mesh.faces == 768
    assert mesh.texture.is_file()


def test_a_flat_mesh_is_accepted_and_measured(tmp_path: Path) -> None:
    (tmp_path / "card.obj").write_text(
        "mtllib card.mtl\nv 0 0 1\nv 0.06 0 1\nv 0.06 0.08 1\nvt 0 0\nvt 1 0\nvt 1 1\nusemtl card\nf 1/1 2/2 3/3\n"
    )
    (tmp_path / "card.mtl").write_text("newmtl card\nmap_Kd card.jpg\n")
    (tmp_path / "card.jpg").write_bytes(encoded(".jpg"))
    mesh = check_mesh(tmp_path / "card.obj")
    assert mesh.path == tmp_path / "card.obj"
    assert mesh.texture == tmp_path / "card.jpg"
    assert mesh.centre_m == pytest.approx((0.03, 0.04, 1.0))
    assert mesh.radius_m == pytest.approx(0.05)
    assert (mesh.vertices, mesh.faces) == (3, 1)


def test_the_digest_follows_the_content_not_the_path(folder: Path, good_product: Path) -> None:
    digest = check_mesh(good_product / OBJ).digest
    assert check_mesh(folder / OBJ).digest == digest
    seen = {digest}
    for name, data in ((OBJ, b"# more\n"), (MTL, b"# more\n"), (PNG, b"\n")):
        (folder / name).write_bytes((folder / name).read_bytes() + data)
        seen.add(check_mesh(folder / OBJ).digest)
    assert len(seen) == 4


def test_a_file_that_is_no_obj_is_refused(tmp_path: Path) -> None:
    (tmp_path / "scan.stl").write_text("solid\n")
    with pytest.raises(BadMesh, match=r"scan\.stl: not a Wavefront OBJ"):
        check_mesh(find_mesh(tmp_path / "scan.stl"))


def test_a_folder_in_place_of_the_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / OBJ).mkdir()
    with pytest.raises(BadMesh, match=r"textured\.obj: the mesh cannot be read \(Is a directory\)"):
        check_mesh(tmp_path / OBJ)


def test_a_mesh_is_found_by_its_name_or_its_folder(folder: Path) -> None:
    assert find_mesh(folder / OBJ) == folder / OBJ
    assert find_mesh(folder) == folder / OBJ


def test_what_is_no_single_mesh_is_not_found(folder: Path, tmp_path: Path) -> None:
    with pytest.raises(BadMesh, match=r"nowhere: does not exist; name an \.obj file or a folder"):
        find_mesh(tmp_path / "nowhere")
    (folder / "another.OBJ").touch()
    with pytest.raises(BadMesh, match=r"several meshes \(another\.OBJ, textured\.obj\); name one file"):
        find_mesh(folder)
    (folder / "another.OBJ").unlink()
    (folder / OBJ).unlink()
    with pytest.raises(BadMesh, match=r"holds no \.obj file"):
        find_mesh(folder)


@pytest.mark.shared
def test_all_scanned_objects_pass() -> None:
    if not SHARED.is_dir():
        pytest.skip(f"the scanned objects are not there: {SHARED}")
    meshes = [check_mesh(find_mesh(path.parent)) for path in sorted(SHARED.glob("*/*/textured.obj"))]
    assert len(meshes) == 41
    assert len({mesh.digest for mesh in meshes}) == 41
    assert all(0.005 < mesh.radius_m < 0.3 for mesh in meshes)
