"""The page of a report: complete in itself, small, escaped, well formed, and right about every kind of ending."""

from __future__ import annotations

import base64
import hashlib
import json
import re
import tomllib
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fnmatch import fnmatch
from functools import partial
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from matplotlib.figure import Figure
from shell import Shell
from told_tasks import record, way

from viewsep.errors import BadInput
from viewsep.messages import (
    CancelRequested,
    DeadlinePassed,
    Event,
    Frame,
    FrameMissing,
    Message,
    MoveFailed,
    MoveTo,
    Outcome,
    RigFailed,
)
from viewsep.models import library
from viewsep.plots import events, svg
from viewsep.plots.page import page_of, write_page
from viewsep.plots.snapshots import STEPS_BYTES, snapshots, spread
from viewsep.plots.steps import STRIP
from viewsep.plots.story import Story, retell
from viewsep.plots.telling import decide
from viewsep.plots.timeline import Axis, moves_of, rows_of
from viewsep.recordings.codec import encode_frame
from viewsep.recordings.reader import Recorded, Recording, read_recording

ROOT = Path(__file__).parents[2]
GOLDEN = ROOT / "tests" / "golden" / "v1.mcap"
DEFAULTS = GOLDEN.with_name("defaults.mcap")
TEMPLATES = ROOT / "viewsep" / "plots" / "templates"
VOID = {"meta", "img", "br", "wbr", "input", "link"}
NASTY = "a\"b'<script>alert(1)</script>&amp;{{ 7 * 7 }}$x^{"
POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{}'; base-uri 'none'; "
    "form-action 'none'"
)


@dataclass
class Element:
    tag: str
    attributes: dict[str, str]
    within: tuple[str, ...]
    text: str = ""


@dataclass
class Page(HTMLParser):
    """The page's elements; complains where they are not closed in order."""

    source: str
    elements: list[Element] = field(default_factory=list)
    open: list[Element] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.feed(self.source)
        self.close()
        assert not self.open, f"never closed: {self.open}"

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        names = [name for name, _ in attrs]
        assert len(names) == len(set(names)), f"<{tag}> has an attribute twice: {names}"
        within = tuple(element.tag for element in self.open)
        element = Element(tag, {name: value or "" for name, value in attrs}, within)
        self.elements.append(element)
        if tag not in VOID:
            self.open.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.handle_starttag(tag, attrs)
        assert tag in VOID or "svg" in [element.tag for element in self.open], f"<{tag}/> outside of SVG"
        if tag not in VOID:
            self.open.pop()

    def handle_endtag(self, tag: str) -> None:
        assert self.open, f"</{tag}> closes nothing"
        assert self.open.pop().tag == tag
        if tag not in ("b", "strong", "span", "a"):
            self.handle_data("\n")

    def handle_data(self, data: str) -> None:
        for element in self.open[-1:] if self.open and self.open[-1].tag in ("script", "style") else self.open:
            element.text += data

    def all(self, tag: str, **attributes: str) -> list[Element]:
        wanted = {name.rstrip("_"): value for name, value in attributes.items()}
        return [e for e in self.elements if e.tag == tag and wanted.items() <= e.attributes.items()]

    def one(self, tag: str, **attributes: str) -> Element:
        (element,) = self.all(tag, **attributes)
        return element

    @property
    def text(self) -> str:
        return " ".join(self.one("body").text.split())

    @property
    def data(self) -> Any:
        return json.loads(self.one("script", id="data").text)


@pytest.fixture(scope="module")
def golden() -> Recording:
    return read_recording(GOLDEN)


@pytest.fixture(scope="module")
def story(golden: Recording) -> Story:
    return retell(golden)


@pytest.fixture(scope="module")
def page(story: Story) -> Page:
    return Page(page_of(story, "v1.mcap"))


@pytest.fixture(scope="module")
def strange(tmp_path_factory: pytest.TempPathFactory) -> Page:
    """Three candidates with names that a library would refuse, cancelled for a strange reason, without pictures."""
    heard: list[Message] = [message for message in way(7) if not isinstance(message, Frame)]
    heard += [FrameMissing(50, f"{NASTY} missing"), CancelRequested(99, f"{NASTY} wishes it")]
    names = [f"{NASTY} one", "<b>two</b>", "_three \u7bb1\u202e\x01"]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(library, "NAME", re.compile(".*"))
        path = tmp_path_factory.mktemp("strange") / "a.mcap"
        recording = record(path, heard, truth=f"{NASTY} truth", names=names)
        return Page(page_of(retell(recording), f"{NASTY}\udcff.mcap").encode("utf-8", "replace").decode())


def without(story: Recording, topic: str) -> Recording:
    return replace(story, messages=tuple(heard for heard in story.messages if heard.topic != topic))


def cut(recording: Recording, at_s: float, *ending: Event) -> Recording:
    """The recording up to a moment, and what happened then instead."""
    kept = tuple(heard for heard in recording.messages if heard.stamp_ns < at_s * 1e9)
    return replace(recording, messages=(*kept, *(Recorded("event", event.stamp_ns, event, b"") for event in ending)))


def with_truth(recording: Recording, truth: str) -> Recording:
    return replace(recording, metadata={**recording.metadata, "task": {**recording.metadata["task"], "truth": truth}})


# What it says


def test_the_decision_comes_first(page: Page) -> None:
    assert page.one("h1").text == "It is product_7_twin_face, and that is right."
    assert page.one("section", class_="answer right")
    assert page.text.index("It is product_7_twin_face") < page.text.index("Key figures")
    assert "Its path rates 6.9 times better than that of product_7 at a separating view." in page.text
    assert "5 times better than every other at 3 looks in a row within 20° of a separating view" in page.text
    (title,) = [e for e in page.all("title") if e.within == ("html", "head")]
    assert title.text == "Identified, right: product_7_twin_face - viewsep report"
    assert "recorded in v1.mcap" in page.text


def test_a_task_by_information_drives_to_telling_views() -> None:
    page = Page(page_of(retell(read_recording(DEFAULTS)), "defaults.mcap"))
    assert re.search(r"\d+ telling views? driven to", page.one("dl", class_="facts").text)
    assert "A telling view is chosen, where product_7 and product_7_twin_face differ" in page.text
    assert "It waits for a look." in page.text
    assert "separating view" not in page.text


def test_the_key_figures_are_those_of_the_recording(page: Page, golden: Recording) -> None:
    says = page.one("dl", class_="facts").text
    for fact in ("33", "162°", "17.6 s", "1774", "simulated rig, not a real one", "gimbal", "viewsep 0.1.0"):
        assert fact in says
    assert "2026-11-27 06:39:44 UTC" in says
    assert "1 separating view reached" in says
    for name, digest in golden.metadata["models"].items():
        assert f"{name} {digest[:8]}" in says
        assert digest in page.text
    for name in ("build", "session", "task"):
        for key, value in golden.metadata[name].items():
            assert key in page.text
            assert value in page.text
    assert "Everything is as by default" not in page.text
    assert tomllib.loads(page.one("pre").text)["camera"]["size_px"] == 80


def test_ratings_stand_beside_what_they_mean(page: Page) -> None:
    words = page.one("table", class_="rated").text.split()
    named = ["product_7_twin_face", "the", "true", "one", "7.33", "1.0", "named"]
    assert words[-12:] == [*named, "product_7", "50.7", "6.9", "ruled", "out"]


def test_every_event_is_told_in_order(page: Page, story: Story) -> None:
    rows, left_out = events.happenings(story)
    assert left_out == 0
    times = [row.at_s for row in rows]
    assert times == sorted(times)
    table = page.one("table", class_="events").text
    for row in rows:
        assert row.words in table
    assert rows[0].words.startswith("The task begins with seed 1")
    assert rows[-1].words.startswith("Result: identified product_7_twin_face")
    assert sum(row.words.startswith("Move ") for row in rows) == 19
    assert sum("is judged" in row.words for row in rows) == 3
    assert "it leads at 3 of 3 looks in a row" in table


# Complete in itself


@pytest.fixture(params=["page", "strange"])
def any_page(request: pytest.FixtureRequest) -> Page:
    found: Page = request.getfixturevalue(request.param)
    return found


def test_nothing_comes_from_elsewhere(any_page: Page) -> None:
    assert not re.search(r"https?:|@import|url\((?!#)", any_page.source, re.IGNORECASE)
    for element in any_page.elements:
        assert element.tag not in ("link", "iframe", "object", "embed", "base", "form", "audio", "video")
        assert not [name for name in element.attributes if name.startswith("on")]
        for name in ("src", "href", "srcset", "action", "data"):
            assert re.match(r"#|data:image/(webp|png);base64,", element.attributes.get(name, "#")), element


def test_the_policy_allows_the_page_s_own_script_and_nothing_else(any_page: Page) -> None:
    scripts = any_page.all("script")
    assert [script.attributes for script in scripts] == [{"type": "application/json", "id": "data"}, {}]
    digest = base64.b64encode(hashlib.sha256(scripts[1].text.encode()).digest()).decode()
    meta = any_page.one("meta", **{"http-equiv": "Content-Security-Policy"})
    assert meta.attributes["content"] == POLICY.format(digest)
    head = [element.tag for element in any_page.elements if element.within == ("html", "head")]
    assert head.index("meta") < head.index("style")


def test_names_are_texts_and_never_markup(strange: Page) -> None:
    assert "alert(1)" not in strange.all("script")[-1].text
    assert [e.text.strip() for e in strange.all("b") if "style" not in e.attributes] == [""]  # that of the heading
    for said in (
        f"{NASTY} one",
        "<b>two</b>",
        f"{NASTY} missing",
        f"Cancelled: {NASTY} wishes it",
        "_three \u7bb1\ufffd\ufffd",
    ):
        assert " ".join(said.split()) in strange.text
    assert f"It was {NASTY} truth." in strange.one("h1").text
    assert f"{NASTY}?.mcap" in strange.text
    assert "49" not in strange.one("h1").text


def test_pictures_are_inside(page: Page) -> None:
    sources = [image.attributes["src"] for image in page.all("img")]
    sources += [source for source in page.data["pictures"] if not source.startswith("#")]
    assert len(sources) == 2 + 2 + STRIP + 1 + (33 - STRIP)
    for source in sources:
        image = cv2.imdecode(np.frombuffer(base64.b64decode(source.split(",")[1]), np.uint8), cv2.IMREAD_COLOR)
        assert image is not None
        assert image.shape in ((80, 80, 3), (48, 48, 3))
        assert image.std() > 5
    assert len(page.source) < 500_000


# Well made


def test_it_can_be_read_by_machines_and_ears(any_page: Page) -> None:
    assert any_page.one("html").attributes["lang"] == "en"
    assert "width=device-width" in any_page.one("meta", name="viewport").attributes["content"]
    names = [e.attributes["id"] for e in any_page.elements if "id" in e.attributes]
    assert len(names) == len(set(names))
    for element in any_page.elements:
        for name in ("aria-labelledby", "aria-describedby"):
            assert element.attributes.get(name, names[0]) in names
        if element.attributes.get("href", "").startswith("#"):
            assert element.attributes["href"][1:] in names
        for name in re.findall(r"url\(#(\w+)\)", " ".join(element.attributes.values())):
            assert name in names
    assert all(image.attributes.get("alt") for image in any_page.all("img"))
    assert all(svg.attributes.get("aria-label") or "aria-hidden" in svg.attributes for svg in any_page.all("svg"))
    assert all(th.attributes.get("scope") in ("row", "col") for th in any_page.all("th"))
    assert all(button.attributes.get("aria-label") for button in any_page.all("button"))
    assert len([image for image in any_page.all("img") if image.within[-1] == "a"]) == len(any_page.all("a"))
    levels = [int(e.tag[1]) for e in any_page.elements if re.fullmatch("h[1-6]", e.tag)]
    assert levels[0] == 1
    assert levels.count(1) == 1
    assert all(after - before <= 1 for before, after in pairwise(levels))


def test_without_the_script_it_shows_the_last_look(page: Page) -> None:
    assert "hidden" in page.one("div", class_="slider").attributes
    last = page.data["steps"][-1]
    assert page.one("span", id="number").text == "33" == str(last["number"])
    assert [e.text for e in page.all("span", class_="fact")] == last["facts"]
    cells = [cell for row in last["cells"] for cell in row]
    shown = page.one("table", class_="estimates").text.split()
    assert [word for word in shown if not word.startswith("product_")][-len(cells) :] == cells
    assert page.one("line", id="cursor").attributes["x1"] == f"{last['percent']}%"


def test_the_script_finds_what_it_steps_through(page: Page, story: Story) -> None:
    steps, pictures = page.data["steps"], page.data["pictures"]
    assert [step["number"] for step in steps] == list(range(1, 34))
    assert [step["percent"] for step in steps] == sorted(step["percent"] for step in steps)
    names = {e.attributes.get("id") for e in page.elements}
    assert {source[1:] for source in pictures if source.startswith("#")} <= names
    assert [step["picture"] for step in steps] == list(range(33))
    assert [step["pictured"] for step in steps] == list(range(1, 34))
    for step, look in zip(steps, story.looks, strict=True):
        best = min(candidate.rating for candidate in look.belief.estimate.candidates)
        assert f"{best:.3g}" in [row[0] for row in step["cells"]]
        assert [len(row) for row in step["cells"]] == [7, 7]
    script = page.all("script")[-1].text
    for name in re.findall(r'at\("([\w-]+)"\)', script):
        assert name in names


STYLE = (TEMPLATES / "page.css").read_text()


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_contrast_is_enough(theme: str) -> None:
    blocks = re.findall(r":root \{(.*?)\}", STYLE, re.DOTALL)
    colours = dict(re.findall(r"--(\w+): (#[0-9a-f]{6})", blocks[theme == "dark"]))
    for text in ("ink", "quiet", "accent", "right", "wrong", "open", "named"):
        assert contrast(colours[text], colours["paper"]) >= 4.5, text
    for text in ("ink", "quiet"):
        assert contrast(colours[text], colours["ground"]) >= 4.5, text
    for mark in ("exploring", "approaching", "judging", "starting", "cursor"):
        assert contrast(colours[mark], colours["paper"]) >= 3.0, mark
    if theme == "dark":
        for hue in svg.DARK_HUES.values():
            assert contrast(hue, colours["paper"]) >= 3.0, hue


def contrast(one: str, other: str) -> float:
    """WCAG 2: the ratio of two colours' relative luminances."""

    def luminance(colour: str) -> float:
        parts = np.array([int(colour[i : i + 2], 16) for i in (1, 3, 5)]) / 255
        linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
        return float(linear @ [0.2126, 0.7152, 0.0722])

    dark, light = sorted([luminance(one), luminance(other)])
    return (light + 0.05) / (dark + 0.05)


def test_the_templates_are_installed() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    patterns = project["tool"]["setuptools"]["package-data"]["viewsep.plots"]
    files = [f"templates/{path.name}" for path in TEMPLATES.iterdir()]
    assert sorted(files) == ["templates/page.css", "templates/page.html", "templates/page.js"]
    assert all(any(fnmatch(file, pattern) for pattern in patterns) for file in files)


# Every kind of ending


CANCEL = CancelRequested(12_000_000_001, "the door is open")
DEADLINE = DeadlinePassed(12_000_000_001)
BROKEN = RigFailed(12_000_000_001, "servo 2 does not answer")

ENDINGS: dict[str, tuple[Callable[[Recording], Recording], str, str, str]] = {
    "right": (lambda r: r, "right", "It is product_7_twin_face, and that is right.", "6.9 times better"),
    "wrong": (
        partial(with_truth, truth="product_7"),
        "wrong",
        "It was taken for product_7_twin_face, and that is wrong: it was product_7.",
        "6.9 times better",
    ),
    "not a candidate": (partial(with_truth, truth="a duck"), "wrong", "it was a duck.", "6.9 times better"),
    "unknown truth": (partial(with_truth, truth=""), "named", "It is product_7_twin_face.", "6.9 times better"),
    "undecided": (
        lambda r: cut(r, 12.0, DEADLINE),
        "undecided",
        "It could not be told which object this is. It was product_7_twin_face.",
        "No separating view was reached.",
    ),
    "undecided near the end": (
        lambda r: cut(r, 17.5, replace(DEADLINE, stamp_ns=17_500_000_001)),
        "undecided",
        "It could not be told",
        "Near the separating views nobody was that far ahead",
    ),
    "cancelled": (lambda r: cut(r, 12.0, CANCEL), "failed", "The task was cancelled", "Cancelled: the door is open."),
    "failed": (lambda r: cut(r, 12.0, BROKEN), "failed", "The task failed", "Servo 2 does not answer."),
    "cut off": (lambda r: cut(r, 12.0), "open", "There is no answer.", "The recording ends before the task does."),
    "empty": (lambda r: replace(r, messages=()), "open", "There is no answer.", "No view was interpreted."),
}


@pytest.mark.parametrize("ending", ENDINGS)
def test_every_ending_is_told(golden: Recording, ending: str) -> None:
    change, kind, sentence, reason = ENDINGS[ending]
    decision = decide(retell(change(golden)))
    assert decision.kind == kind
    assert sentence in decision.sentence
    assert any(reason in said for said in decision.reasons)


def concluded(told: Story, outcome: Outcome, **more: Any) -> Story:
    """The story as if the engine had come to another result."""
    assert told.end is not None
    assert told.end.result is not None
    result = replace(told.end.result, **{"outcome": outcome, "object": "", "reason": "why it is so", **more})
    return replace(told, end=replace(told.end, result=result))


def named_by(told: Story, truth: str) -> Story:
    return replace(told, task={**told.task, "truth": truth})


TWINS = ("product_7", "product_7_twin_face")
BELOW = np.array([0.0, 0.0, -1.0])
CONCLUSIONS: dict[str, tuple[Outcome, tuple[str, ...], str, str, str, str]] = {
    "no candidate": (
        *(Outcome.UNKNOWN, (), "a duck", "right", "Unknown, right"),
        "It is none of the candidates, and that is right: it was a duck.",
    ),
    "a candidate": (
        *(Outcome.UNKNOWN, (), "product_7", "wrong", "Unknown, wrong"),
        "It was taken for none of the candidates, and that is wrong: it was product_7.",
    ),
    "who knows": (
        *(Outcome.UNKNOWN, (), "", "named", "Unknown, truth not recorded"),
        "It is none of the candidates.",
    ),
    "twins": (
        *(Outcome.INDISTINGUISHABLE, TWINS, "product_7", "undecided", "Indistinguishable"),
        "It is product_7 or product_7_twin_face: which of them, no view that this rig can show tells. "
        "It was product_7.",
    ),
    "twins, who knows": (
        *(Outcome.INDISTINGUISHABLE, TWINS, "", "undecided", "Indistinguishable"),
        "It is product_7 or product_7_twin_face: which of them, no view that this rig can show tells.",
    ),
    "neither": (
        *(Outcome.INDISTINGUISHABLE, TWINS, "a duck", "wrong", "Indistinguishable, wrong"),
        "It was taken for product_7 or product_7_twin_face, and that is wrong: it was a duck.",
    ),
}


@pytest.mark.parametrize("ending", CONCLUSIONS)
def test_every_conclusion_is_told(story: Story, ending: str) -> None:
    outcome, indistinct, truth, kind, badge, sentence = CONCLUSIONS[ending]
    told = concluded(named_by(story, truth), outcome, indistinct=indistinct, telling_view=BELOW if indistinct else None)
    decision = decide(told)
    assert (decision.kind, decision.badge, decision.sentence) == (kind, badge, sentence)
    would = "; azimuth 0°, elevation -90° would, which it cannot reach" if indistinct else ""
    assert decision.reasons[0] == f"Why it is so{would}."
    assert told.differs


def test_a_pose_that_is_known_is_told(story: Story) -> None:
    spread_rad = float(np.radians(4.2))
    assert (
        "Pose known to ±4°."
        in decide(concluded(story, Outcome.IDENTIFIED, object="product_7", pose_spread_rad=spread_rad)).reasons
    )
    assert not any("known to" in reason for reason in decide(story).reasons)


def probable(told: Story, best: float = 0.9, unknown: float | None = 0.02) -> Story:
    """The story as if an interpreter with probabilities had told it: the best one's grows from look to look."""
    looks = []
    for number, look in enumerate(told.looks, start=1):
        share = best * number / len(told.looks)
        first, second = look.belief.estimate.candidates
        rated = (replace(first, probability=1.0 - share - (unknown or 0.0)), replace(second, probability=share))
        estimate = replace(look.belief.estimate, candidates=rated, unknown=unknown)
        looks.append(replace(look, belief=replace(look.belief, estimate=estimate)))
    return replace(told, looks=looks)


def test_probabilities_take_the_place_of_ratings(story: Story) -> None:
    page = Page(page_of(probable(story)))
    rated = page.one("table", class_="rated").text
    assert rated.split()[-15:] == [
        *("product_7_twin_face", "the", "true", "one", "90.0", "%", "named"),
        *("product_7", "8.0", "%", "none", "of", "them", "2.0", "%"),
    ]
    assert "Probabilities after the last look" in rated
    assert "Times the best" not in rated
    assert "Probability (at the end 90.0 %)" in page.text
    assert "Ratings" not in page.text
    assert "paths begin" not in page.text


def test_probabilities_are_stepped_through(story: Story) -> None:
    page = Page(page_of(probable(story)))
    rows = page.data["steps"][-1]["cells"]
    assert [row[2] for row in rows] == ["90.0 %", "8.0 %", "2.0 %"]
    assert [len(row) for row in rows] == [8, 8, 8]
    assert set(rows[2]) == {"", "2.0 %"}
    table = page.one("table", class_="estimates")
    assert table.text.split()[-5:] == ["none", "of", "them", "2.0", "%"]
    without = Page(page_of(probable(story, unknown=None)))
    assert [row[2] for row in without.data["steps"][-1]["cells"]] == ["90.0 %", "10.0 %"]
    for kind in ("rated", "estimates"):
        assert "none of them" not in without.one("table", class_=kind).text
    assert "Probability" not in Page(page_of(story)).text


def test_an_unknown_object_says_how_probable_that_is(story: Story) -> None:
    told = named_by(concluded(probable(story, 0.05, 0.93), Outcome.UNKNOWN), "a duck")
    page = Page(page_of(told))
    said = "none of them 93.0\u00a0%, product_7_twin_face 5.0\u00a0%, product_7 2.0\u00a0%."
    assert f"How probable they were at the end: {said}" in decide(told).reasons
    rated = page.one("table", class_="rated").text.split()
    assert rated[-9:] == ["none", "of", "them", "the", "true", "one", "93.0", "%", "named"]
    assert "Probability (at the end none of them 93.0 %)" in page.text


def test_troubles_have_their_rows(golden: Recording) -> None:
    last = [h for h in golden.messages if isinstance(h.message, MoveTo) and h.stamp_ns < 12e9][-1]
    assert isinstance(last.message, MoveTo)
    at_s = last.stamp_ns / 1e9 + 0.001
    failed = MoveFailed(last.stamp_ns + 200_000_000, last.message.command_id, "the joints did not arrive")
    missing = [FrameMissing(12_100_000_000 + i, "no frame came") for i in (0, 100_000_000)]
    told = retell(cut(golden, at_s, failed, *missing, replace(CANCEL, stamp_ns=13_000_000_000)))
    rows = {row.name: row.spans for row in rows_of(told)}
    assert [span.kind for span in rows["Missing frames: 2"]] == ["missing", "missing"]
    assert [span.words for span in rows["Stops: 1"]] == ["the door is open, 13.0 s"]
    assert "failed: the joints did not arrive" in rows["Failed moves: 1"][0].words
    words = [row.words for row in events.happenings(told)[0] if row.kind == "trouble"]
    assert words[0].endswith(": failed after 0.2 s: the joints did not arrive")
    assert words[1:3] == ["No usable picture: no frame came"] * 2
    assert words[3] == "Somebody asks to end the task: the door is open"


def test_the_timeline_covers_the_task(story: Story) -> None:
    phases, looks, moves, failed, missing, stops = rows_of(story)
    assert [span.kind for span in phases.spans] == ["starting", "exploring", "approaching", "judging", "exploring"]
    ends = [span.left + span.width for span in phases.spans]
    assert phases.spans[0].left == 0.0
    assert ends[:-1] == pytest.approx([span.left for span in phases.spans[1:]], abs=0.2)
    assert ends[-1] == pytest.approx(100.0, abs=0.2)
    assert (looks.name, moves.name, failed.name) == ("Looks: 33", "Moves: 19", "Failed moves: 0")
    assert (missing.spans, len(stops.spans)) == ([], 1)
    for row in (phases, looks, moves, stops):
        assert all(0.0 <= span.left <= span.left + span.width <= 100.0 for span in row.spans)
    assert [move.arrived for move in moves_of(story)] == [True] * 18 + [False]


@pytest.mark.parametrize(
    ("seconds", "last"), [(0.0, "0 s"), (3e-8, "3e-08 s"), (1.0, "1 s"), (17.6, "15 s"), (700, "600 s")]
)
def test_times_have_round_labels(seconds: float, last: str) -> None:
    ticks = Axis(5, 5 + round(seconds * 1e9)).ticks()
    assert ticks[0] == (0.0, "0 s")
    assert ticks[-1][1] == last
    assert len(ticks) <= 7


def test_a_replay_that_decides_otherwise_is_told(golden: Recording) -> None:
    told = retell(replace(golden, messages=tuple(h for h in golden.messages if h.topic == "result")))
    assert told.differs
    says = Page(page_of(told)).text
    assert "Replayed differently." in says
    assert "Recorded: identified product_7_twin_face after 33 looks. Replayed: no result." in says
    assert not retell(golden).differs


def test_without_pictures_it_says_so(strange: Page) -> None:
    assert "The recording holds no camera pictures." in strange.text
    assert not strange.all("ol", class_="strip")
    assert not strange.all("img", id="picture")
    assert {step["picture"] for step in strange.data["steps"]} == {-1}
    assert len(strange.all("img")) == 3  # the models' thumbnails


def test_nothing_at_all_makes_a_page(golden: Recording) -> None:
    page = Page(page_of(retell(replace(golden, messages=(), frames=()))))
    assert page.one("h1").text == "There is no answer. It was product_7_twin_face."
    assert "No view was interpreted: there are no paths to show." in page.text
    assert len(page.all("script")) == 1


def test_many_looks_and_candidates_stay_small(tmp_path: Path) -> None:
    told = retell(record(tmp_path / "a.mcap", [*way(30), DeadlinePassed(99)], 12))
    many = replace(told, looks=(told.looks * 25)[:400])
    page = Page(page_of(many))
    assert len(page.source) < 2_000_000
    assert len(page.data["steps"]) == 400
    assert len(page.all("ol", class_="strip")[0].text.split()) == STRIP
    assert len(page.all("figure", class_="view mine")) == 12
    assert ", and 8 more" in page.one("dl", class_="facts").text
    assert [len(row) for row in (page.data["steps"][0]["cells"], many.models)] == [12, 12]


def test_pictures_are_as_many_as_fit(story: Story) -> None:
    noise = np.random.default_rng(1).integers(0, 256, (240, 320, 3), np.uint8)
    jpeg = encode_frame(Frame(0, 0, noise, None))[0][1].data
    frames = [replace(story.frames[0], jpeg=jpeg, mask_png=None)]
    pictures = snapshots(replace(story, looks=story.looks[:1] * 40, frames=frames))
    assert 2 < len(pictures) < 40
    assert {0, 39} <= set(pictures)
    assert 0.3 * STEPS_BYTES < sum(map(len, pictures.values())) <= STEPS_BYTES
    image = cv2.imdecode(np.frombuffer(pictures[0], np.uint8), cv2.IMREAD_COLOR)
    assert image is not None
    assert image.shape == (180, 240, 3)


@pytest.mark.parametrize("count", [0, 1, 2, 3, 24, 25, 400])
@pytest.mark.parametrize("most", [1, 2, 24])
def test_a_choice_is_even_and_has_both_ends(count: int, most: int) -> None:
    chosen = spread(count, most)
    assert len(chosen) == min(count, most)
    assert chosen == sorted(set(chosen))
    if count and most > 1:
        assert (chosen[0], chosen[-1]) == (0, count - 1)
        assert len({after - before for before, after in pairwise(chosen)}) <= 2


def test_of_many_events_the_middle_is_left_out(story: Story, monkeypatch: pytest.MonkeyPatch) -> None:
    every, _ = events.happenings(story)
    monkeypatch.setattr(events, "MOST", 10)
    rows, left_out = events.happenings(story)
    assert rows == every[:5] + every[-5:]
    assert left_out == len(every) - 10


# Writing it


def test_the_command_writes_a_page(tmp_path: Path, shell: Shell) -> None:
    record(tmp_path / "a & b.mcap", [*way(1), DeadlinePassed(99)])
    ended = shell("report", tmp_path / "a & b.mcap", "-o", tmp_path / "a.HTML")
    assert (ended.code, ended.out) == (0, f"report: {tmp_path / 'a.HTML'}\n")
    page = Page((tmp_path / "a.HTML").read_text(encoding="utf-8"))
    assert "recorded in a & b.mcap" in page.text
    assert "It could not be told which object this is. It was object_0." in page.text
    assert len(page.data["steps"]) == 1
    write_page(read_recording(tmp_path / "a & b.mcap"), tmp_path / "again.html", "a & b.mcap")
    assert (tmp_path / "again.html").read_bytes() == (tmp_path / "a.HTML").read_bytes()
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a & b.mcap", "a.HTML", "again.html"]


def test_other_kinds_are_refused(tmp_path: Path, shell: Shell) -> None:
    ended = shell("report", GOLDEN, "-o", tmp_path / "run.pdf")
    assert ended.code == 2
    assert "run.pdf: a report is a page or a picture: give a name that ends in .html or .png" in " ".join(
        ended.err.split()
    )
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path, golden: Recording) -> None:
    with pytest.raises(BadInput, match=r"cannot write the page .*none"):
        write_page(replace(golden, messages=(), frames=()), tmp_path / "none" / "x.html")


# Figures


def test_figures_take_the_page_s_colours_and_clash_with_nothing() -> None:
    def drawn(name: str) -> str:
        figure = Figure(figsize=(2, 2))
        axes = figure.add_subplot()
        axes.plot([0, 1, 2], [1, 3, 2], color="#0072B2", marker="o")
        axes.plot([0, 1, 2], [2, 2, 2], color="0.65")
        return str(svg.inline(figure, name, 'a "label" & <more>'))

    one, other = drawn("one"), drawn("other")
    assert one == drawn("one")
    parsed = Page(f"<body>{one}{other}</body>")
    names = [e.attributes["id"] for e in parsed.elements if "id" in e.attributes]
    assert len(names) == len(set(names)) > 2
    assert parsed.all("svg")[0].attributes["aria-label"] == 'a "label" & <more>'
    assert "#0072b2" not in one
    light, dark = svg.themes(one)
    assert "--0072b2:#0072b2;" in light
    assert f"--0072b2:{svg.DARK_HUES['0072b2']};" in dark
    assert "--a6a6a6:#a6a6a6;" in light
    assert set(re.findall(r"var\((--\w+)\)", one)) == set(re.findall(r"(--\w+):", light))
    assert "xmlns" not in one
