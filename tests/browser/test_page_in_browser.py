"""The page of a report in a real browser: its script, its policy, light and dark, wide and narrow."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path

import chromium
import pytest
from chromium import Chromium

from viewsep.plots.page import write_page
from viewsep.recordings.reader import read_recording

GOLDEN = Path(__file__).parents[1] / "golden" / "v1.mcap"

pytestmark = [
    pytest.mark.browser,
    pytest.mark.skipif(
        chromium.COMMAND is None,
        reason="CHROMIUM IS MISSING, nothing was tested: apt-get install --no-install-recommends chromium",
    ),
]


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "run.html"
    write_page(read_recording(GOLDEN), path, GOLDEN.name)
    return path.as_uri()


@pytest.fixture(scope="module")
def started() -> Iterator[Chromium]:
    with Chromium() as browser:
        yield browser


@pytest.fixture
def browser(started: Chromium, address: str) -> Chromium:
    """The page, open on a wide light screen."""
    screen(started, 1280, "light")
    started.call("Emulation.setScriptExecutionDisabled", value=False)
    started.open(address)
    return started


def screen(browser: Chromium, width: int, scheme: str) -> None:
    browser.call("Emulation.setDeviceMetricsOverride", width=width, height=900, deviceScaleFactor=1, mobile=False)
    browser.call("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": scheme}])


def number(browser: Chromium) -> str:
    shown: str = browser.tell("document.getElementById('number').textContent")
    return shown


def place(browser: Chromium, selector: str) -> tuple[float, float]:
    """The middle of an element, after it was scrolled into the window."""
    x, y = browser.tell(
        f"(() => {{ const e = document.querySelector({selector!r}); e.scrollIntoView({{block: 'center'}});"
        "const b = e.getBoundingClientRect(); return [b.x + b.width / 2, b.y + b.height / 2]; })()"
    )
    return x, y


def test_it_asks_for_nothing_and_complains_of_nothing(browser: Chromium, address: str) -> None:
    browser.tell("document.querySelectorAll('details').forEach(part => { part.open = true; })")
    assert browser.complaints() == []
    assert browser.requests() == [address]
    assert browser.tell("[...document.images].every(image => image.complete && image.naturalWidth > 0)")


def test_the_policy_stops_whatever_would_ask(browser: Chromium) -> None:
    stopped = browser.tell(
        "new Promise(tell => { document.addEventListener('securitypolicyviolation', e => tell(e.effectiveDirective));"
        "document.body.append(Object.assign(new Image(), {src: 'http://127.0.0.1:9/x.png'})); })"
    )
    assert stopped == "img-src"
    assert browser.tell("fetch('http://127.0.0.1:9/').then(() => 'went through', () => 'stopped')") == "stopped"
    assert (
        browser.tell(
            "(() => { const s = document.createElement('script'); s.textContent = 'window.ran = 1';"
            "document.body.append(s); return typeof window.ran; })()"
        )
        == "undefined"
    )


def test_keys_step_through_the_looks(browser: Chromium) -> None:
    assert number(browser) == "33"
    assert browser.tell("document.getElementById('on').disabled")
    browser.tell("document.getElementById('step').focus()")
    last = browser.tell("document.getElementById('picture').src")
    for _ in range(3):
        browser.press("ArrowLeft")
    assert number(browser) == "30"
    assert browser.tell("document.getElementById('step').ariaValueText").startswith("look 30, 16.8 s, approaching")
    assert browser.tell("document.getElementById('pictured').textContent") == "Picture of look 30"
    assert browser.tell("document.getElementById('picture').src") != last
    browser.press("Home")
    assert number(browser) == "1"
    assert browser.tell("document.getElementById('back').disabled")
    step = browser.tell("JSON.parse(document.getElementById('data').textContent).steps[0]")
    rows = "[...document.querySelectorAll('.estimates tbody tr')]"
    assert browser.tell(f"{rows}.map(row => [...row.cells].slice(1).map(cell => cell.textContent))") == step["cells"]
    assert browser.tell("[...document.querySelectorAll('.fact')].map(fact => fact.textContent)") == step["facts"]
    assert browser.tell("document.getElementById('cursor').getAttribute('x1')") == f"{step['percent']}%"


FIFTH = ".strip li:nth-child(5)"


def test_thumbnails_and_the_timeline_choose_a_look(browser: Chromium) -> None:
    browser.click(*place(browser, f"{FIFTH} a"))
    assert number(browser) == browser.tell(f"document.querySelector('{FIFTH} a').dataset.look")
    source = browser.tell(f"document.querySelector('{FIFTH} img').src")
    assert browser.tell("document.getElementById('picture').src") == source
    assert browser.tell("location.hash") == ""
    _, y = place(browser, "#timeline")
    left = browser.tell("document.getElementById('timeline').getBoundingClientRect().left")
    browser.click(left + 1, y)
    assert number(browser) == "1"
    assert browser.complaints() == []


def test_thumbnails_grow_under_the_pointer_and_with_the_keyboard(browser: Chromium) -> None:
    size = f"document.querySelector('{FIFTH} img').getBoundingClientRect().width"
    browser.tell(
        "document.head.append(Object.assign(document.createElement('style'), "
        "{textContent: '* { transition: none !important; }'}))"
    )
    small = browser.tell(size)
    x, y = place(browser, f"{FIFTH} a")
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    assert browser.tell(size) == pytest.approx(2.5 * small, rel=0.05)
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=2, y=2)
    assert browser.tell(size) == pytest.approx(small, rel=0.05)
    browser.tell("document.querySelector('.strip li:nth-child(4) a').focus()")
    browser.press("Tab")
    assert browser.tell(size) == pytest.approx(2.5 * small, rel=0.05)


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [320, 390, 768, 1280])
def test_it_fits_every_screen(browser: Chromium, width: int, scheme: str) -> None:
    screen(browser, width, scheme)
    assert browser.tell("document.documentElement.scrollWidth") == width
    ground = browser.tell("getComputedStyle(document.body).backgroundColor")
    assert ground == {"light": "rgb(244, 245, 247)", "dark": "rgb(15, 16, 18)"}[scheme]
    ink = browser.tell("getComputedStyle(document.querySelector('.plot')).fill")
    assert ink == {"light": "rgb(0, 0, 0)", "dark": "rgb(232, 232, 232)"}[scheme]
    inside = "[...document.querySelectorAll('body *')].filter(e => !e.closest('.scroll, pre, svg'))"
    too_far = "filter(e => e.getBoundingClientRect().right > innerWidth + 1).map(e => e.outerHTML.slice(0, 80))"
    assert browser.tell(f"{inside}.{too_far}") == []


def test_it_can_be_read_without_its_script(browser: Chromium, address: str) -> None:
    browser.call("Emulation.setScriptExecutionDisabled", value=True)
    browser.open(address)
    assert number(browser) == "33"
    assert browser.tell("getComputedStyle(document.querySelector('.slider')).display") == "none"
    assert browser.tell("document.getElementById('picture').naturalWidth") > 0


def test_it_prints_light_and_whole(browser: Chromium) -> None:
    screen(browser, 1280, "dark")
    pdf = base64.b64decode(browser.call("Page.printToPDF", printBackground=True)["data"])
    assert pdf.startswith(b"%PDF")
    browser.call(
        "Emulation.setEmulatedMedia", media="print", features=[{"name": "prefers-color-scheme", "value": "dark"}]
    )
    assert browser.tell("getComputedStyle(document.querySelector('.plot')).fill") == "rgb(0, 0, 0)"
    assert browser.tell("document.querySelector('.events').getBoundingClientRect().height") > 100
    browser.call("Emulation.setEmulatedMedia", media="", features=[])
