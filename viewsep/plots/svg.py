"""Figures as SVG inside an HTML page: small, without names that clash, in colours that follow the page's theme."""

from __future__ import annotations

import re
from collections.abc import Iterator
from io import StringIO
from itertools import pairwise
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import matplotlib as mpl
from markupsafe import Markup
from matplotlib.colors import to_hex
from matplotlib.figure import Figure

DARK_HUES = {
    "0072b2": "#4ea5e0",
    "009e73": "#2fc296",
    "cc79a7": "#dd8fba",
    "56b4e9": "#7cc7f2",
    "d55e00": "#f07f3a",
    "f0e442": "#f0e442",
}
"""Colours of lines and marks, and those that stand for them on dark paper."""
DARK_PAPER, DARK_INK = 0x18, 0xE8  # what white and black become

_NO_METADATA = dict.fromkeys(("Date", "Creator", "Format", "Type"))
_NUMBER = re.compile(r"-?\d*\.\d+(?:e-?\d+)?")
_COLOUR = re.compile(r"#([0-9a-f]{6})\b")
_VARIABLE = re.compile(r"var\(--([0-9a-f]{6})\)")
_LETTER = re.compile(r"\s*([A-Za-z])\s*")
_LENGTHS = ("d", "x", "y", "width", "height")


def inline(figure: Figure, name: str, label: str) -> Markup:
    """The figure as an `<svg>` element. `name` is unique in the page, `label` is for those who cannot see it."""
    text = StringIO()
    with mpl.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(text, format="svg", transparent=True, metadata=_NO_METADATA)
    root = ElementTree.fromstring(text.getvalue())
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
        element.tail = None
        element.text = element.text if element.text and element.text.strip() else None
        element.attrib = dict(_attributes(element))
    for parent in list(root.iter()):
        _join_lines(parent)
        _share_style(parent)
    root.attrib = {"viewBox": root.attrib["viewBox"], "class": "plot", "role": "img", "aria-label": label}
    for rules in [child for child in root if child.find("style") is not None]:
        root.remove(rules)  # the page has them
    return Markup(ElementTree.tostring(root, encoding="unicode"))


def css_colour(colour: str) -> str:
    """A colour of the figures for the page around them."""
    return f"var(--{to_hex(colour)[1:]})"


def themes(text: str) -> tuple[str, str]:
    """Declarations of the colours that `text`, figures and all, uses: for light and for dark paper."""
    used = sorted(set(_VARIABLE.findall(text)))
    light, dark = ("".join(f"--{code}:{colour(code)};" for code in used) for colour in ("#{}".format, _on_dark))
    return light, dark


def _on_dark(code: str) -> str:
    """What stands for a colour on dark paper: greys change places, hues become lighter."""
    if code in DARK_HUES:
        return DARK_HUES[code]
    grey = round(DARK_INK + (DARK_PAPER - DARK_INK) * int(code[:2], 16) / 255)
    return f"#{grey:02x}{grey:02x}{grey:02x}"


def _attributes(element: Element) -> Iterator[tuple[str, str]]:
    """The attributes that matter, shorter; names only where they may be referred to."""
    digits = 2 if element.tag == "path" and "id" in element.attrib else 1  # marks are small
    for key, value in element.attrib.items():
        match key.rpartition("}")[2]:
            case "id" if element.tag in ("path", "clipPath"):
                yield "id", value
            case "href":
                yield "href", "".join(value.split())
            case "style":
                yield "style", _style(value)
            case "transform" if not value.startswith("rotate(-0 "):
                yield "transform", value
            case short if short in _LENGTHS:
                yield short, _compact(_NUMBER.sub(lambda number: _rounded(number[0], digits), value))
            case "viewBox" | "points" | "clip-path" as short:
                yield short, value


def _style(text: str) -> str:
    """Colours by their variables, fonts as the page's."""
    rules = [rule.strip().replace(": ", ":") for rule in text.split(";")]
    kept = ";".join(rule for rule in rules if rule and not rule.startswith("font-family"))
    return _COLOUR.sub(lambda code: f"var(--{code[1]})" if _has_theme(code[1]) else code[0], kept)


def _has_theme(code: str) -> bool:
    return code in DARK_HUES or code[:2] == code[2:4] == code[4:]


def _rounded(number: str, digits: int) -> str:
    text = f"{float(number):.{digits}f}".rstrip("0").rstrip(".")
    return "0" if text in ("-0", "") else text


def _compact(path: str) -> str:
    """A path without spaces that say nothing, and without the letter of lines that follow lines."""
    path = _LETTER.sub(r"\1", path)
    return path if "C" in path or "Q" in path else path.replace("L", " ")


def _join_lines(parent: Element) -> None:
    """Strokes of one kind that follow each other become one path; see-through ones stay apart, for they add up."""
    for line, following in list(pairwise(reversed(parent))):
        style = line.get("style", "")
        same = {**line.attrib, "d": ""} == {**following.attrib, "d": ""}
        if line.tag == following.tag == "path" and same and "fill:none" in style and "opacity" not in style:
            following.set("d", following.get("d", "") + line.get("d", ""))
            parent.remove(line)


def _share_style(parent: Element) -> None:
    """Marks of one kind take their style from what is around them."""
    styles = {mark.get("style", "") for mark in parent}
    if (
        len(parent) > 1
        and len(styles) == 1
        and all(mark.tag == "use" for mark in parent)
        and "opacity" not in min(styles)
    ):
        parent.set("style", min(styles))
        for mark in parent:
            del mark.attrib["style"]
