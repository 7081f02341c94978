"""Damaged pictures are noticed, whole ones are decoded."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from fake_camera import yuyv
from hypothesis import given, settings
from hypothesis import strategies as st

from viewsep.drivers.v4l2.exposures import Exposures
from viewsep.drivers.v4l2.pictures import Damaged, decoded, sharpness, whole
from viewsep.drivers.v4l2.settings import V4l2Settings
from viewsep.messages import Array

WIDTH, HEIGHT = 160, 120
MJPG = V4l2Settings("/dev/video0", "MJPG", WIDTH, HEIGHT)
YUYV = V4l2Settings("/dev/video0", "YUYV", WIDTH, HEIGHT)
IMAGE = cv2.GaussianBlur(np.random.default_rng(3).integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8), (0, 0), 2)


def coded(restart: int = 4) -> bytes:
    return cv2.imencode(".jpg", IMAGE, [cv2.IMWRITE_JPEG_RST_INTERVAL, restart])[1].tobytes()


DATA, PLAIN = coded(), coded(0)


def array(data: bytes) -> Array:
    return np.frombuffer(data, np.uint8).reshape(1, -1)


@pytest.mark.parametrize("data", [DATA, coded(0), DATA + bytes(500)], ids=["restarts", "no restarts", "padded"])
def test_a_whole_picture_is_decoded_to_rgb(data: bytes) -> None:
    image = decoded(whole(array(data), MJPG), MJPG)
    assert image.shape == (HEIGHT, WIDTH, 3)
    assert np.abs(image.astype(int) - IMAGE[..., ::-1]).mean() < 6


def test_a_picture_that_is_not_compressed_is_decoded_to_rgb() -> None:
    red = np.zeros((HEIGHT, WIDTH, 3), np.uint8)
    red[..., 2] = 200
    image = decoded(whole(yuyv(red), YUYV), YUYV)
    assert image.shape == (HEIGHT, WIDTH, 3)
    assert image[..., 0].min() > 150 > 60 > image[..., 1:].max()


def outcome(data: bytes) -> str:
    """What is wrong with a picture; empty where nothing is seen to be."""
    try:
        decoded(whole(array(data), MJPG), MJPG)
    except Damaged as error:
        return str(error)
    return ""


@given(st.integers(0, len(DATA) - 1))
def test_a_picture_that_ends_too_early_is_damaged(length: int) -> None:
    assert outcome(DATA[:length])


@given(st.integers(0, len(PLAIN) - 1), st.integers(400, 2000))
def test_a_picture_that_lost_a_part_is_damaged(at: int, length: int) -> None:
    kept = PLAIN[:at] + PLAIN[at + length :]
    assert outcome(kept), f"{len(kept)} of {len(PLAIN)} bytes are taken for a whole picture"


@given(st.binary(max_size=300))
def test_any_bytes_are_judged_without_another_exception(data: bytes) -> None:
    assert outcome(data)
    assert outcome(DATA[: 2 + len(data)] + data)


@pytest.mark.parametrize(
    ("data", "said"),
    [
        (b"", "does not begin"),
        (DATA[1:], "does not begin"),
        (DATA[:-2], "its end is missing"),
        (DATA[: len(DATA) // 2] + b"\xff\xd9", "premature end of data segment"),
        (DATA[:-2] + bytes([7] * 100) + DATA[-2:], "extraneous bytes"),
    ],
)
def test_what_is_wrong_is_said(data: bytes, said: str) -> None:
    assert said in outcome(data)


def test_some_bytes_too_many_at_the_end_are_what_webcams_send() -> None:
    assert outcome(DATA[:-2] + bytes([7] * 20) + DATA[-2:]) == ""


def test_a_picture_without_tables_is_what_webcams_send_too() -> None:
    at, kept = 2, DATA[:2]
    while DATA[at + 1] != 0xDA:
        length = 2 + int.from_bytes(DATA[at + 2 : at + 4], "big")
        kept += DATA[at : at + length] if DATA[at + 1] != 0xC4 else b""
        at += length
    bare = kept + DATA[at:]
    assert len(bare) < len(DATA) - 300
    np.testing.assert_array_equal(decoded(array(bare), MJPG), decoded(array(DATA), MJPG))


def test_a_picture_of_another_size_is_damaged() -> None:
    other = V4l2Settings("/dev/video0", "MJPG", WIDTH, HEIGHT + 8)
    with pytest.raises(Damaged, match="it is 160 x 120 instead of 160 x 128"):
        decoded(array(DATA), other)


@pytest.mark.parametrize("raw", [None, np.zeros((HEIGHT, WIDTH, 3), np.uint8), np.zeros((HEIGHT, WIDTH, 2), np.uint16)])
def test_bytes_of_another_shape_are_no_picture(raw: object) -> None:
    with pytest.raises(Damaged):
        whole(raw, YUYV)


def test_a_sharp_picture_is_sharper_than_a_blurred_one() -> None:
    assert sharpness(IMAGE) > 2 * sharpness(cv2.GaussianBlur(IMAGE, (0, 0), 2)) > 0
    assert sharpness(np.full((20, 20, 3), 90, np.uint8)) == 0.0


def numbers(stamps_ms: list[int], nominal_ms: int = 33) -> list[int]:
    exposures = Exposures(nominal_ms * 1_000_000)
    return [exposures.number(stamp * 1_000_000) for stamp in stamps_ms]


def test_a_gap_in_the_stamps_is_a_gap_in_the_numbers() -> None:
    assert numbers([5, 38, 71, 170, 203]) == [0, 1, 2, 5, 6]


def test_a_slow_camera_has_not_lost_every_second_frame() -> None:
    exposures = Exposures(33_000_000)
    for _ in range(6):
        exposures.learn(66_000_000)
    assert [exposures.number(k * 66_000_000) for k in range(5)] == [0, 1, 2, 3, 4]


@settings(max_examples=30)
@given(st.sets(st.integers(1, 299), max_size=120), st.integers(0, 2**31))
def test_numbers_are_right_whatever_is_lost_and_however_stamps_jitter(lost: set[int], seed: int) -> None:
    jitter_ms = np.random.default_rng(seed).integers(-3, 4, 300)
    came = [k for k in range(300) if k < 8 or k not in lost]
    assert numbers([1000 + 33 * k + int(jitter_ms[k]) for k in came]) == came


def test_what_was_not_exposed_while_the_camera_was_away_is_not_counted() -> None:
    exposures = Exposures(33_000_000)
    assert [exposures.number(stamp) for stamp in (0, 33_000_000)] == [0, 1]
    exposures.restart()
    assert exposures.number(9_000_000_000) == 2
