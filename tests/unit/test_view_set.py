"""A list of photos is read as it stands; what cannot be is refused with file, line and remedy."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from view_sets import GROUND, photo, ring, write_view_set

from viewsep.errors import BadInput
from viewsep.geometry import spherical_direction
from viewsep.messages import Array
from viewsep.sim.segmentation import segment
from viewsep.sim.view_choice import every_kth, named_views
from viewsep.sim.view_set import is_view_set, read_view_set

AZIMUTHS = (0.0, 10.5, 120.0, -90.0)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return write_view_set(tmp_path / "tin", 1, ring(*AZIMUTHS))


def rewrite(folder: Path, change: Callable[[str], str]) -> None:
    path = folder / "views.csv"
    path.write_text(change(path.read_text()))


def test_it_holds_what_is_listed_in_that_order(folder: Path) -> None:
    view_set = read_view_set(folder)
    assert view_set.name == "tin"
    assert view_set.folder == folder.resolve()
    assert view_set.images == ("v000.png", "v001.png", "v002.png", "v003.png")
    assert view_set.masks == ("m000.png", "m001.png", "m002.png", "m003.png")
    expected = [spherical_direction(np.radians(azimuth), np.radians(20.0)) for azimuth in AZIMUTHS]
    np.testing.assert_allclose(view_set.directions, expected, atol=1e-12)
    for index, azimuth in enumerate(AZIMUTHS):
        image, mask = view_set.load(index)
        np.testing.assert_array_equal(image, photo(1, azimuth, 20.0)[0])
        np.testing.assert_array_equal(mask, photo(1, azimuth, 20.0)[1])
        assert mask.dtype == np.bool_


def test_the_digest_is_that_of_the_list_and_of_all_listed_files(folder: Path, tmp_path: Path) -> None:
    digests = [read_view_set(folder).digest]
    assert read_view_set(write_view_set(tmp_path / "copy", 1, ring(*AZIMUTHS))).digest == digests[0]
    (folder / "unlisted.png").write_bytes(b"anything")
    assert read_view_set(folder).digest == digests[0]
    for name in ("v002.png", "m000.png", "views.csv"):
        with (folder / name).open("ab") as file:
            file.write(b"\n")
        digests.append(read_view_set(folder).digest)
    assert len(set(digests)) == len(digests)


@given(azimuth=st.floats(-1e4, 1e4), elevation=st.floats(-90, 90))
def test_every_direction_is_read_exactly(
    azimuth: float, elevation: float, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("set")
    (folder / "a.png").write_bytes(b"decoded when it is loaded")
    (folder / "views.csv").write_text(f"image,azimuth_deg,elevation_deg\na.png,{azimuth!r},{elevation!r}\n")
    expected = spherical_direction(np.radians(azimuth), np.radians(elevation))
    np.testing.assert_array_equal(read_view_set(folder).directions, [expected])


def test_spreadsheets_may_add_a_byte_order_mark_spaces_and_empty_lines(folder: Path) -> None:
    before = read_view_set(folder)
    rewrite(folder, lambda text: "\ufeff" + text.replace(",", " , ").replace("\n", "\r\n\r\n"))
    after = read_view_set(folder)
    assert after.images == before.images
    np.testing.assert_array_equal(after.directions, before.directions)


def test_columns_may_come_in_any_order(folder: Path) -> None:
    rewrite(folder, lambda _: "mask,elevation_deg,image,azimuth_deg\n,20,v000.png,7\n")
    view_set = read_view_set(folder)
    assert (view_set.images, view_set.masks) == (("v000.png",), ("",))
    np.testing.assert_array_equal(view_set.angles_deg, [[7.0, 20.0]])


def test_an_empty_mask_cell_means_that_this_one_is_cut_out(folder: Path) -> None:
    rewrite(folder, lambda text: text.replace("m001.png", ""))
    _, mask = read_view_set(folder).load(1)
    np.testing.assert_array_equal(mask, photo(1, 10.5, 20.0)[1])


def test_without_masks_all_are_cut_out(tmp_path: Path) -> None:
    view_set = read_view_set(write_view_set(tmp_path / "tin", 2, ring(*AZIMUTHS), masks=False))
    for index, azimuth in enumerate(AZIMUTHS):
        np.testing.assert_array_equal(view_set.load(index)[1], photo(2, azimuth, 20.0)[1])


LINE = "v000.png,0,20,m000.png"
BAD_LISTS: dict[str, tuple[str, str]] = {
    "empty": ("", r"views.csv: is empty; its first line names the columns image,azimuth_deg"),
    "no views": ("image,azimuth_deg,elevation_deg\n", "views.csv: lists no views; add one line per photo"),
    "column missing": ("image,azimuth_deg\nv000.png,0", "views.csv, line 1: column 'elevation_deg' is missing"),
    "column unknown": (
        "image,azimuth_deg,elevation_deg,masks\nv000.png,0,20,m000.png",
        "line 1: column 'masks' is not known; the columns are image,",
    ),
    "column twice": ("image,azimuth_deg,elevation_deg,image\nv000.png,0,20,", "line 1: column 'image' is there twice"),
    "word": (f"HEAD\n{LINE}\nv001.png,east,20,", "line 3: azimuth_deg = 'east' is not a number; write degrees"),
    "nothing": ("HEAD\nv000.png,,20,", "line 2: azimuth_deg = '' is not a number"),
    "nan": ("HEAD\nv000.png,0,nan,", "line 2: elevation_deg = 'nan' is not a number"),
    "infinite": ("HEAD\nv000.png,inf,0,", "line 2: azimuth_deg = 'inf' is not a number"),
    "elevation": ("HEAD\nv000.png,0,90.5,", r"line 2: elevation_deg = 90.5 is outside \[-90, 90\]; it counts"),
    "cell missing": ("HEAD\nv000.png,0,20", "line 2: has 3 cells for 4 columns; write image,"),
    "cell too many": ("HEAD\nv000.png,0,20,,x", "line 2: has 5 cells for 4 columns"),
    "no image": ("HEAD\n,0,20,", "line 2: names no image"),
    "image missing": ("HEAD\nv009.png,0,20,", r"line 2: there is no file 'v009.png' in .*tin; correct the name"),
    "mask missing": ("HEAD\nv000.png,0,20,m9.png", "line 2: there is no file 'm9.png'"),
    "image elsewhere": ("HEAD\n../v000.png,0,20,", "line 2: '../v000.png' lies outside the folder; put all files"),
    "image twice": (f"HEAD\n{LINE}\n\nv000.png,5,20,", "line 4: image 'v000.png' is in line 2 already; list it once"),
    "direction twice": (
        f"HEAD\n{LINE}\nv001.png,360,20.01,",
        "line 3: azimuth 360 deg, elevation 20.01 deg is the direction of line 2 already; keep one photo",
    ),
    "pole twice": ("HEAD\nv000.png,0,90,\nv001.png,50,90,", "line 3: .* is the direction of line 2 already"),
    "open quote": ('HEAD\n"v000.png,0,20,', "cannot read the list of views .*views.csv: "),
}


@pytest.mark.parametrize(("text", "words"), BAD_LISTS.values(), ids=list(BAD_LISTS))
def test_a_bad_list_is_refused(folder: Path, text: str, words: str) -> None:
    rewrite(folder, lambda _: text.replace("HEAD", "image,azimuth_deg,elevation_deg,mask"))
    with pytest.raises(BadInput, match=words) as refused:
        read_view_set(folder)
    assert str(folder / "views.csv") in str(refused.value)


def test_a_list_that_cannot_be_read_is_refused(tmp_path: Path, folder: Path) -> None:
    with pytest.raises(BadInput, match=r"cannot read the list of views .*nowhere/views.csv"):
        read_view_set(tmp_path / "nowhere")
    (folder / "views.csv").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(BadInput, match=r"cannot read the list of views .*tin/views.csv"):
        read_view_set(folder)


def painted(path: Path, image: Array) -> None:
    cv2.imwrite(str(path), image)


BAD_FILES: dict[str, tuple[str, Callable[[Path], object], str]] = {
    "image empty": ("v000.png", lambda p: p.write_bytes(b""), "v000.png: is not a picture, or damaged; save"),
    "image is text": ("v000.png", lambda p: p.write_text("hello"), "v000.png: is not a picture"),
    "mask is text": ("m000.png", lambda p: p.write_text("hello"), "m000.png: is not a picture"),
    "mask of another size": (
        "m000.png",
        lambda p: painted(p, np.full((32, 48), 255, np.uint8)),
        "m000.png: the mask is 48 x 32, but v000.png is 64 x 64 pixels; make the mask from",
    ),
    "mask empty": ("m000.png", lambda p: painted(p, np.zeros((64, 64), np.uint8)), "m000.png: the mask is empty"),
    "image gone": ("v000.png", Path.unlink, "cannot read the photo .*v000.png: No such file"),
}


@pytest.mark.parametrize(("name", "spoil", "words"), BAD_FILES.values(), ids=list(BAD_FILES))
def test_a_bad_file_is_refused_when_it_is_loaded(
    folder: Path, name: str, spoil: Callable[[Path], object], words: str
) -> None:
    view_set = read_view_set(folder)
    spoil(folder / name)
    with pytest.raises(BadInput, match=words):
        view_set.load(0)
    view_set.load(1)


def test_an_object_touching_the_border_and_a_noisy_background_are_cut_out_well() -> None:
    rng = np.random.default_rng(0)
    image = np.full((90, 120, 3), 200.0)
    truth = np.zeros((90, 120), bool)
    truth[60:, 40:80] = True
    image[truth] = (30, 60, 90)
    mask = segment(np.clip(image + rng.normal(0, 4, image.shape), 0, 255).astype(np.uint8), "x.png")
    assert (mask & truth).sum() / (mask | truth).sum() > 0.95


def test_dark_holes_belong_to_the_object_and_dust_does_not() -> None:
    image, truth = photo(1, 0.0, 20.0, 128)
    image[60:70, 60:70] = GROUND
    image[5:8, 5:8] = 255
    np.testing.assert_array_equal(segment(image, "x.png"), truth)


def test_what_cannot_be_cut_out_is_refused() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    with pytest.raises(BadInput, match=r"x.png: only \d+% of the picture's border has one colour .* plain background"):
        segment(noise, "x.png")
    with pytest.raises(BadInput, match=r"x.png: nothing stands out from the background"):
        segment(np.full((64, 64, 3), 90, np.uint8), "x.png")
    inside = np.full((400, 400, 3), 90, np.uint8)
    inside[2:-2, 2:-2] = 250
    with pytest.raises(BadInput, match=r"x.png: no background is left around the object"):
        segment(inside, "x.png")


def test_pictures_are_reduced_and_made_square_but_not_enlarged(tmp_path: Path) -> None:
    folder = write_view_set(tmp_path / "tin", 1, ring(0.0, 90.0))
    wide, mask = photo(1, 0.0, 20.0, 200)
    painted(folder / "v000.png", wide[40:160, :, ::-1])
    painted(folder / "m000.png", mask[40:160].astype(np.uint8) * 255)
    view_set = read_view_set(folder)
    image, mask = view_set.picture(0, 100)
    assert image.shape == (100, 100, 3)
    assert mask.shape == (100, 100)
    assert not mask[:20].any()
    assert not mask[-20:].any()
    assert (image[0] == GROUND).all()
    assert mask.mean() == pytest.approx(0.5 * 0.6, abs=0.02)
    small, _ = view_set.picture(1, 100)
    np.testing.assert_array_equal(small, photo(1, 90.0, 20.0)[0])


def test_an_object_too_small_for_the_camera_is_refused(tmp_path: Path) -> None:
    folder = write_view_set(tmp_path / "tin", 1, ring(0.0))
    dot = np.zeros((64, 64), np.uint8)
    dot[5, 5] = 255
    painted(folder / "m000.png", dot)
    with pytest.raises(BadInput, match=r"v000.png: at 32 pixels nothing is left .* 'camera.size_px'"):
        read_view_set(folder).picture(0, 32)


def test_a_folder_with_a_list_is_a_view_set_unless_it_holds_a_mesh_too(folder: Path, tmp_path: Path) -> None:
    assert is_view_set(folder)
    assert not is_view_set(tmp_path)
    assert not is_view_set(folder / "v000.png")
    assert not is_view_set(tmp_path / "nowhere")
    (folder / "tin.obj").write_text("")
    with pytest.raises(BadInput, match=r"tin: holds both views.csv and tin.obj, .*; name the mesh file, or move"):
        is_view_set(folder)


def test_every_kth_listed_view_is_chosen(folder: Path) -> None:
    view_set = read_view_set(folder)
    assert every_kth(view_set, 1) == [0, 1, 2, 3]
    assert every_kth(view_set, 3) == [0, 3]
    with pytest.raises(BadInput, match="--every 0: use 1 for all photos"):
        every_kth(view_set, 0)


def test_named_views_are_chosen_in_the_order_of_the_set(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "nodes.txt"
    path.write_text("# front\nv002.png\n\n  v000.png  # back\n")
    assert named_views(read_view_set(folder), path) == [0, 2]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("v000.png\nv9.png", "nodes.txt, line 2: .*tin lists no image 'v9.png'; write names .* e.g. v000.png"),
        ("v000.png\n\nv000.png", "nodes.txt, line 3: 'v000.png' is in line 1 already; name each image once"),
        ("# nothing\n", "nodes.txt: names no images; write one per line"),
    ],
)
def test_a_bad_list_of_nodes_is_refused(folder: Path, tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "nodes.txt"
    path.write_text(text)
    with pytest.raises(BadInput, match=words):
        named_views(read_view_set(folder), path)
    with pytest.raises(BadInput, match=r"cannot read the list of nodes .*gone.txt"):
        named_views(read_view_set(folder), tmp_path / "gone.txt")


@pytest.mark.shared
def test_turntable_photos_are_read_and_cut_out(shared: Path) -> None:
    folder = shared / "photos" / "coil100" / "obj032"
    view_set = read_view_set(folder)
    assert len(view_set.images) == 69
    np.testing.assert_allclose(view_set.directions[:, 2], np.sin(np.radians(25.0)))
    cut = dataclasses.replace(view_set, masks=("",) * 69)
    shares = [cut.picture(index, 128)[1].mean() for index in range(0, 69, 8)]
    assert all(0.4 < share < 0.95 for share in shares)  # the tin fills most of each photo, the ground is dark
