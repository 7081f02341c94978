"""Whatever a user gets wrong ends in one sentence on stderr and exit code 2, and leaves nothing half-written."""

from __future__ import annotations

import io
import json
import re
import shutil
import sys
import zipfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from view_sets import ring, write_view_set

from viewsep.cli import main
from viewsep.config import Config
from viewsep.geometry import delaunay_edges, equidistant_sphere
from viewsep.learning import learn_view_set
from viewsep.messages import JointState
from viewsep.models import library
from viewsep.models.aspect_graph import AspectGraph, Provenance
from viewsep.plugins import make_descriptor
from viewsep.recording import task_recorder
from viewsep.sim.products import ProductSpec, write_product

Before = Callable[[], object]
"""Spoils something in the current folder."""
DESCRIPTOR = make_descriptor(Config().descriptor)
OTHER = DESCRIPTOR.parameters | {"rings.rings": 8}


@dataclass(frozen=True)
class Case:
    """What is typed in a folder with the library `lib` (models tea and decaf), `run.mcap` of both and a mesh `box`.

    `tin` holds photos, `photolib` the models `tin` and `can` learned from photos.
    """

    typed: str
    words: str
    before: Before = lambda: None
    simulated: bool = False


def model(name: str, seed: int) -> AspectGraph:
    directions = equidistant_sphere(12)
    return AspectGraph(
        name=name,
        directions=directions,
        edges=delaunay_edges(directions),
        features=np.random.default_rng(seed).dirichlet(np.ones(DESCRIPTOR.size), 12).astype(np.float32),
        thumbnails=np.zeros((12, 48, 48, 3), np.uint8),
        descriptor=DESCRIPTOR.name,
        descriptor_parameters=DESCRIPTOR.parameters,
        provenance=Provenance(f"generated:{seed}", "0" * 64, "viewsep test"),
    )


@pytest.fixture(scope="session")
def workspace(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("workspace")
    models = [model("tea", 1), model("decaf", 2)]
    for known in models:
        library.save(known, folder / "lib")
    with task_recorder(folder / "run.mcap", Config(), models, 0, "tea") as recorder:
        recorder.hear(0, JointState(0, (0.0, 0.0), (0.0, 0.0), False))
    write_product(ProductSpec(1), folder / "box")
    for seed, name in enumerate(("tin", "can")):
        photos = write_view_set(folder / name, seed, ring(*range(0, 360, 20)))
        library.save(learn_view_set(photos, name, Config(), every=2), folder / "photolib")
    return folder


def config(text: str) -> Before:
    return lambda: Path("c.toml").write_text(text)


def text(name: str, content: str) -> Before:
    return lambda: Path(name).write_text(content)


def damaged(name: str, change: Callable[[bytes], bytes]) -> Before:
    return lambda: Path(name).write_bytes(change(Path(name).read_bytes()))


def flipped(data: bytes) -> bytes:
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 1]) + data[middle + 1 :]


def half(data: bytes) -> bytes:
    return data[: len(data) // 2]


def other_header(key: str, value: object) -> Before:
    """Replaces one key in the header of tea's model."""

    def change(data: bytes) -> bytes:
        with np.load(io.BytesIO(data)) as archive:
            arrays = {name: archive[name] for name in archive.files}
        header = {**json.loads(arrays["header"].tobytes()), key: value}
        arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **arrays)
        return buffer.getvalue()

    return damaged("lib/tea.viewsep", change)


def other_archive() -> None:
    with zipfile.ZipFile("lib/tea.viewsep", "w") as archive:
        archive.writestr("readme.txt", "hello")


def relearned(**changes: object) -> Before:
    """Puts a changed, but whole, model of tea into the library."""
    return lambda: library.save(replace(model("tea", 1), **changes), Path("lib"))  # type: ignore[arg-type]


def joints(first: str) -> Before:
    return config(f'[rig]\n[[rig.joints]]\nname = "pan"\n{first}\n')


def servos(bus: str, preset: str = "turntable", mode: str = "extended") -> Before:
    return config(
        f'[rig]\nbackend="dynamixel"\npreset="{preset}"\n[dynamixel]\n{bus}\n[[dynamixel.servos]]\njoint="pan"\nid=1\n'
        f'mode="{mode}"\n'
    )


def views_csv(content: str) -> Before:
    """Replaces the list of the photos in `tin`."""
    return text("tin/views.csv", content)


def held_tin_changed() -> None:
    """Has the model of `tin` in `photolib` come from the photos here, and changes one of them."""
    known = library.load(Path("photolib/tin.viewsep"))
    moved = replace(known.provenance, source=str(Path("tin").resolve()))
    library.save(replace(known, provenance=moved), Path("photolib"))
    Path("tin/unlisted.txt").touch()
    views_csv(Path("tin/views.csv").read_text() + "\n")()


SEPARATE = "separate --models lib --truth tea"
WITH_CONFIG = f"{SEPARATE} --config c.toml"
REPLAY = "replay run.mcap --verify"
PHOTO_SEPARATE = "separate --models photolib --truth tin"
PHOTOS = "learn -o new --jobs 1"
LEARN = "learn -o new --views 12 --jobs 1"
BENCH = "bench separation --pairs pairs.csv --jobs 1"

CASES: dict[str, Case] = {
    # meshes and generated products
    "mesh missing": Case(f"{LEARN} nowhere", r"nowhere: does not exist; name an \.obj file or a folder"),
    "mesh folder without a mesh": Case(f"{LEARN} lib", r"lib: the folder holds no \.obj file; name the mesh"),
    "mesh without texture": Case(
        f"{LEARN} box", "names a texture that is missing", Path("box/texture_map.png").unlink, simulated=True
    ),
    "second mesh broken": Case(
        f"{LEARN} generated:1 box",
        "box/textured.obj: is not a text file",
        text("box/textured.obj", "\0"),
        simulated=True,
    ),
    "generated without a seed": Case(f"{LEARN} generated:", "'generated:' is not a generated product .*; write"),
    "generated with a word": Case(f"{LEARN} generated:tea", "'generated:tea' is not a generated product"),
    "generated negative": Case(f"{LEARN} generated:-1", "'generated:-1' is not a generated product"),
    "generated unknown twin": Case(f"{LEARN} generated:1:twin=hat", "twin=hat' is not .*twin=face|sticker|none"),
    "sticker without a sticker": Case(
        f"{LEARN} generated:1:twin=face:sticker=0.1", "a sticker it does not have; write"
    ),
    "sticker too large": Case(f"{LEARN} generated:1:twin=sticker:sticker=7", "sticker"),
    "held object unknown": Case("separate --models lib --object generated:x", "'generated:x' is not", simulated=True),
    # photos
    "photos with a bad line": Case(
        f"{PHOTOS} tin",
        "tin/views.csv, line 2: azimuth_deg = 'x' is not a number",
        views_csv("image,azimuth_deg,elevation_deg\nv000.png,x,0\n"),
    ),
    "photos missing": Case(f"{PHOTOS} tin", "line 19: there is no file 'v017.png' in tin", Path("tin/v017.png").unlink),
    "photo damaged": Case(f"{PHOTOS} tin", "tin/v000.png: is not a picture", damaged("tin/v000.png", lambda _: b"x")),
    "photos and a mesh": Case(f"{PHOTOS} tin", "tin: holds both views.csv and tin.obj, so", text("tin/tin.obj", "")),
    "photos too few": Case(f"{PHOTOS} tin --every 9", "tin: 2 of 18 photos as nodes are too few"),
    "nodes twice": Case(
        f"{PHOTOS} tin --nodes n.txt",
        "n.txt, line 2: 'v001.png' is in line 1 already",
        text("n.txt", "v001.png\nv001.png"),
    ),
    "nodes unknown": Case(f"{PHOTOS} tin --nodes n.txt", "n.txt, line 1: .*lists no image 'x'", text("n.txt", "x")),
    "nodes missing": Case(f"{PHOTOS} tin --nodes n.txt", "cannot read the list of nodes n.txt"),
    "every none": Case(f"{PHOTOS} tin --every 0", "--every 0: use 1 for all photos"),
    "every and nodes": Case(f"{PHOTOS} tin --every 2 --nodes n.txt", "--every and --nodes exclude each other"),
    "every of a mesh": Case(f"{PHOTOS} generated:1 --every 2", "--every 2 goes with photos, but generated:1 has no"),
    "nodes of a mesh": Case(f"{PHOTOS} box --nodes n.txt", "--nodes n.txt goes with photos, but box has no views.csv"),
    "views of photos": Case(f"{PHOTOS} tin --views 50", "--views 50 goes with meshes, but tin holds photos: use --ev"),
    "photos changed": Case(PHOTO_SEPARATE, "tin has changed since model 'tin' was learned from it", held_tin_changed),
    "photos of another rig": Case(
        f"{PHOTO_SEPARATE} --config c.toml",
        "key 'rig.preset' is set, but the rig over the photos in .*tin follows from their directions: remove",
        config('[rig]\npreset = "gimbal"'),
    ),
    "photos that slip": Case(
        f"{PHOTO_SEPARATE} --config c.toml", "key 'sim.slip_deg' = 3: photos have", config("[sim]\nslip_deg = 3")
    ),
    "views without photos": Case(
        f"{PHOTO_SEPARATE} --config c.toml",
        "c.toml: key 'rig.views_deg' goes with rig.backend = 'photos'",
        config("[rig]\nviews_deg = [[0, 0]]"),
    ),
    "a mesh on a photo rig": Case(
        WITH_CONFIG, "rig.backend = 'photos', but generated:1 is not a folder", config('[rig]\nbackend = "photos"')
    ),
    "held mesh missing": Case("separate --models lib --object nowhere", "nowhere: does not exist", simulated=True),
    # learning
    "too few views": Case("learn -o new generated:1 --views 3", "--views 3: use 12 to 2000 views"),
    "too many views": Case("learn -o new generated:1 --views 2001", "--views 2001: use 12 to 2000 views"),
    "two of one name": Case(f"{LEARN} box box", "two of the sources would be called 'box': rename a folder, or"),
    "one name for two": Case(f"{LEARN} generated:1 generated:2 --name tea", "--name 'tea' goes with one source, but 2"),
    "name with a slash": Case(f"{LEARN} box --name a/b", "'a/b' cannot name an object: use letters"),
    "name of nothing": Case(f"{LEARN} box --name=", "'' cannot name an object"),
    "library is a file": Case(
        "learn -o run.mcap generated:1 --views 12",
        "cannot make the library run.mcap: .*; choose another",
        simulated=True,
    ),
    "library below a file": Case(
        "learn -o run.mcap/lib generated:1 --views 12", "cannot make the library run.mcap/lib: ", simulated=True
    ),
    # libraries
    "no library": Case("models nowhere", "no library at nowhere: make one with `viewsep learn"),
    "library is no folder": Case("models run.mcap", "no library at run.mcap"),
    "library empty": Case("models empty", "the library empty holds no models: fill it", Path("empty").mkdir),
    "separate without library": Case("separate --models nowhere --truth tea", "no library at nowhere"),
    "model truncated": Case(
        "models lib", "lib/tea.viewsep: not a viewsep model, or damaged", damaged("lib/tea.viewsep", half)
    ),
    "model changed": Case(
        "models lib", "lib/tea.viewsep: .*learn the object again", damaged("lib/tea.viewsep", flipped)
    ),
    "model empty": Case("models lib", "lib/tea.viewsep: not a viewsep model", text("lib/tea.viewsep", "")),
    "model is another zip": Case("models lib", "lib/tea.viewsep: not a viewsep model", other_archive),
    "model is a folder": Case("models lib", r"cannot read the model lib/box.viewsep", Path("lib/box.viewsep").mkdir),
    "model renamed": Case(
        "models lib",
        "lib/box.viewsep: holds the object 'tea'; rename it to tea.viewsep",
        lambda: Path("lib/tea.viewsep").rename("lib/box.viewsep"),
    ),
    "model of another version": Case(
        "models lib", "lib/tea.viewsep: schema version 9, but this viewsep reads 2", other_header("schema_version", 9)
    ),
    "model with another hash": Case(
        SEPARATE, "tea.viewsep: its content has the hash .* its header says abc: ", other_header("digest", "abc")
    ),
    "model without provenance": Case("models lib", "key 'provenance' is incomplete", other_header("provenance", {})),
    "models of two descriptors": Case(
        SEPARATE,
        "'tea' was learned with descriptor opponent.rings .*'rings.rings': 8.*says opponent.rings .*: learn it",
        relearned(descriptor_parameters=OTHER),
    ),
    "config of another descriptor": Case(
        WITH_CONFIG,
        "model 'decaf' was learned .* change the key 'descriptor'",
        config("[descriptor]\nname='cch'"),
    ),
    "plot into nothing": Case("models lib --plot nowhere/sheet.png", "nowhere"),
    # servos
    "doctor of nothing": Case("rig doctor", "give --config FILE, or --port PORT where there is none yet"),
    "doctor of a simulation": Case(
        "rig doctor --config c.toml", "c.toml: rig.backend = 'sim' has no servos: `viewsep rig init`", config("")
    ),
    "scan at no baud": Case("rig scan --port /dev/null --baud 5", "--baud 5: servos know 9600, 57600"),
    "init over a file": Case("rig init --preset wrist -o run.mcap", "run.mcap exists: choose another name with -o"),
    "init of a strange port": Case('rig init --preset wrist --port a"b', "is no name of a port: `viewsep rig ports`"),
    "init into nothing": Case("rig init --preset wrist -o nowhere/c.toml", "cannot write the configuration nowhere"),
    "home of emulated servos": Case(
        "rig home --config c.toml", "dynamixel.port = 'emulated': there is nothing to set up", servos('port="emulated"')
    ),
    "a zero at no angle": Case(
        "rig home --config c.toml --joint pan --at-stop --stop-deg nan",
        "--stop-deg nan is no angle",
        servos('port="/dev/x"'),
    ),
    "servo for no joint": Case(
        "rig jog --config c.toml --joint pan --by-deg 1",
        r"'dynamixel.servos' is for the joints \['pan'\], but the rig has \['tilt', 'pan'\]",
        servos('port="/dev/x"', "pan_tilt"),
    ),
    "servo with an impossible range": Case(
        "rig calibrate --config c.toml --repeats 1",
        "joint 'pan': mode = 'position' reaches 0 to 4095 counts, but its limits need -inf to inf",
        servos('port="/dev/x"', mode="position"),
    ),
    # configuration
    "config missing": Case(WITH_CONFIG, "cannot read the configuration c.toml: .*No such file"),
    "config is no text": Case(
        WITH_CONFIG, "cannot read the configuration c.toml", lambda: Path("c.toml").write_bytes(b"\xff\xfe")
    ),
    "config is no TOML": Case(WITH_CONFIG, "c.toml is not TOML: .*line 1", config("rig: {}")),
    "unknown key": Case(
        WITH_CONFIG, "c.toml: unknown key 'rig.prest': check the spelling", config("[rig]\nprest='wrist'")
    ),
    "unknown table": Case(WITH_CONFIG, "c.toml: unknown key 'robot': check the spelling", config("[robot]\n")),
    "unknown option": Case(
        WITH_CONFIG,
        "unknown key 'interpreter.options.rotation': interpreter 'filter' has rotations, independent_after_deg",
        config("[interpreter.options]\nrotation = 5000"),
    ),
    "wrong option": Case(
        WITH_CONFIG,
        "interpreter.options, key 'variant' = 'best'",
        config("[interpreter]\nname='path'\n[interpreter.options]\nvariant='best'"),
    ),
    "wrong type": Case(
        WITH_CONFIG, "c.toml: key 'task.max_looks' = 'many': .*integer", config("[task]\nmax_looks='many'")
    ),
    "table instead of value": Case(WITH_CONFIG, "c.toml: key 'task' = 3: ", config("task = 3")),
    "out of range": Case(WITH_CONFIG, "key 'sim.drop_rate' = 1: .*less than 1", config("[sim]\ndrop_rate=1")),
    "not a number": Case(WITH_CONFIG, "key 'camera.rate_hz' = nan: ", config("[camera]\nrate_hz = nan")),
    "endless time": Case(WITH_CONFIG, "key 'task.deadline_s' = inf: .*finite", config("[task]\ndeadline_s = inf")),
    "unknown preset": Case(
        WITH_CONFIG, "key 'rig.preset' = 'arm': choose one of turntable, pan_tilt", config("[rig]\npreset='arm'")
    ),
    "unknown backend": Case(WITH_CONFIG, "key 'rig.backend' = 'ur5': .*'sim'", config("[rig]\nbackend='ur5'")),
    "preset and joints": Case(
        WITH_CONFIG,
        "keys 'rig.preset' and 'rig.joints' exclude each other: remove one",
        config('[rig]\npreset="wrist"\n[[rig.joints]]\nname="pan"\naxis=[0,0,1]'),
    ),
    "zero axis": Case(WITH_CONFIG, r"joint 'pan': axis \[0.*\] has no direction; use", joints("axis=[0,0,0]")),
    "axis of two numbers": Case(WITH_CONFIG, r"key 'rig\.joints\.0\.axis", joints("axis=[0,1]")),
    "swapped limits": Case(
        WITH_CONFIG,
        "joint 'pan': lower limit 90 deg is not below the upper limit 10 deg",
        joints("axis=[0,0,1]\nlower_deg=90\nupper_deg=10"),
    ),
    "unknown descriptor": Case(
        WITH_CONFIG, "no descriptor is called 'sift': choose one of cch", config("[descriptor]\nname='sift'")
    ),
    "unknown interpreter": Case(
        WITH_CONFIG, "no interpreter is called 'pf': choose one of filter, path", config("[interpreter]\nname='pf'")
    ),
    "interpreter option": Case(f"{SEPARATE} --interpreter pf", "no interpreter is called 'pf'"),
    "unknown planner": Case(WITH_CONFIG, "no planner is called 'fast': choose", config("[planner]\nname='fast'")),
    "no hypotheses": Case(
        WITH_CONFIG, "hypotheses", config("[interpreter]\nname='path'\n[interpreter.options]\nhypotheses = 0")
    ),
    "no step": Case(WITH_CONFIG, "step_deg", config("[planner.options]\nstep_deg = 0.0")),
    "no pixel distance": Case(
        f"{LEARN} generated:1 --config c.toml",
        "distance_px",
        config("[descriptor]\nname='cch'\n[descriptor.options]\ndistance_px = 0"),
        simulated=True,
    ),
    # candidates and what is held
    "unknown candidate": Case(
        f"{SEPARATE} --candidates tea,coffee", "no model 'coffee' in the library lib: it has decaf, tea"
    ),
    "empty candidate": Case(f"{SEPARATE} --candidates tea,", "--candidates 'tea,' has an empty name: write e.g."),
    "candidate twice": Case(f"{SEPARATE} --candidates tea,tea", "candidate 'tea' is named twice: name each once"),
    "one candidate": Case(f"{SEPARATE} --candidates tea", "1 candidate: there is nothing to separate; learn another"),
    "truth unknown": Case(
        "separate --models lib --truth coffee", "--truth 'coffee' is not a candidate: choose one of decaf, tea"
    ),
    "truth not a candidate": Case(
        "separate --models lib --truth tea --candidates decaf", "--truth 'tea' is not a candidate"
    ),
    "nothing held": Case("separate --models lib", "must hold something: give --truth NAME .* or --object SOURCE"),
    "two things held": Case(f"{SEPARATE} --object generated:1", "--truth NAME .* --object SOURCE .*, not both"),
    "mesh changed": Case(
        SEPARATE, "generated:1 has changed since model 'tea' was learned from it: learn it", simulated=True
    ),
    # recordings
    "recording exists": Case(
        "separate --models lib --object generated:1 --record run.mcap",
        "run.mcap: exists already; choose",
        simulated=True,
    ),
    "recording's folder missing": Case(
        "separate --models lib --object generated:1 --record nowhere/run.mcap",
        "nowhere/run.mcap: the folder nowhere does not exist; create it",
        simulated=True,
    ),
    "recording is a folder": Case(
        "separate --models lib --object generated:1 --record lib --force", "lib: is a folder; give", simulated=True
    ),
    "replay of nothing": Case("replay nowhere.mcap --verify", "nowhere.mcap: no such file; check the name"),
    "replay of a folder": Case("replay lib --verify", "lib: cannot be read"),
    "replay of a model": Case("replay lib/tea.viewsep --verify", "tea.viewsep: does not start as an MCAP file"),
    "replay of an empty file": Case(REPLAY, "run.mcap: is empty; record again", text("run.mcap", "")),
    "replay of a changed byte": Case(
        REPLAY, "run.mcap: .*does not match its CRC; .viewsep recordings recover", damaged("run.mcap", flipped)
    ),
    "replay of half a file": Case(
        REPLAY, "run.mcap: .*truncated; .viewsep recordings recover", damaged("run.mcap", half)
    ),
    "replay without events": Case(REPLAY, "the recording holds no events that can be replayed"),
    "replay without percepts": Case("replay run.mcap --from-frames", "the recording holds no percepts"),
    "replay to no end": Case("replay run.mcap", "nothing to do: give --verify, --from-frames or --models"),
    "replay with another library": Case(
        "replay run.mcap --models lib",
        "made with model tea [0-9a-f]{12}, but the library has [0-9a-f]{12}: replay with",
        relearned(descriptor_parameters=OTHER),
    ),
    "replay with half a library": Case(
        "replay run.mcap --models lib", "no model 'decaf' in the library lib", Path("lib/decaf.viewsep").unlink
    ),
    "report of nothing": Case("report nowhere.mcap -o r.png", "nowhere.mcap: no such file"),
    "report of half a file": Case("report run.mcap -o r.png", "run.mcap: .*truncated", damaged("run.mcap", half)),
    # lists of pairs
    "no pairs": Case(BENCH, "cannot read the pairs pairs.csv: .*No such file"),
    "pairs are empty": Case(BENCH, "pairs.csv: a list of pairs needs the columns a,b", text("pairs.csv", "")),
    "pairs without rows": Case(BENCH, "pairs.csv: .* at least one row", text("pairs.csv", "a,b\n")),
    "pairs without columns": Case(BENCH, "pairs.csv: .* the columns a,b", text("pairs.csv", "x,y\n1,2\n")),
    "pair with an empty cell": Case(
        BENCH,
        "pairs.csv, line 3: a pair needs two names, found 'box' and ''",
        text("pairs.csv", "a,b\nbox,lib\nbox,\n"),
    ),
    "pair with a missing cell": Case(
        BENCH, "pairs.csv, line 2: a pair needs two names", text("pairs.csv", "a,b\nbox\n")
    ),
    "pairs are binary": Case(BENCH, "cannot read the pairs", lambda: Path("pairs.csv").write_bytes(b"\xff\xfe")),
    "pair of a missing mesh": Case(
        BENCH, "nowhere: does not exist", text("pairs.csv", "a,b\nbox,nowhere\n"), simulated=True
    ),
    "bench objects are nowhere": Case(
        "bench separation --objects nowhere", "--objects nowhere: there is no such folder"
    ),
    "bench objects are none": Case("bench separation --objects lib", "none of its sub-folders holds a mesh"),
    "bench twins": Case("bench separation --twins side", "--twins 'side' is none of face, sticker, none"),
    "bench twins and pairs": Case(f"{BENCH} --twins face", "--twins generates objects: leave out --pairs"),
    "bench candidates": Case("bench separation --candidates 21", "--candidates 21 needs 21 objects, but there are 20"),
    "bench measures": Case("bench separation --interpreter path --measures w1,w7", "--measures 'w7' is none of w0"),
    "bench measures of a posterior": Case(
        "bench separation --measures w1", "--measures 'w1' is about path hypotheses: add --interpreter path"
    ),
    "bench measures twice": Case(
        "bench separation --interpreter path --measures w1,w1", "--measures 'w1,w1': separate different names"
    ),
    "bench baselines": Case(
        "bench separation --baselines hog", "--baselines 'hog' is none of nearest, vote, sift, random"
    ),
    "bench disturbance without value": Case("bench pose --disturb light", "--disturb 'light': write KEY=NUMBER"),
    "bench disturbance unknown": Case("bench pose --disturb fog=1", "--disturb 'fog=1': unknown key 'fog'"),
    "bench disturbance too strong": Case("bench pose --disturb light=3", "--disturb 'light=3': key 'light' = 3.0"),
    "bench rig": Case("bench pose --rig crane", "key 'rig.preset' = 'crane': choose one of turntable"),
    "bench interpreter": Case(
        "bench separation --interpreter oracle --json r.json", "no interpreter is called 'oracle'"
    ),
    "bench planner": Case("bench separation --planner oracle", "no planner is called 'oracle'"),
    "bench resume without a result": Case("bench pose --resume", "--resume goes on with .* give the same --json FILE"),
    "bench result without a folder": Case("bench pose --json no/r.json", "--json no/r.json: there is no folder no"),
    "bench jobs": Case("bench pose --jobs 0", "--jobs 0: give a number of processes"),
    "bench scheduler": Case("bench pose --scheduler here", "here.*tcp://"),
    "bench plot is a file": Case("bench pose --plot f", "f", text("f", "")),
    "bench pose of photos": Case(
        "bench pose --objects set",
        "set/tea holds photos, but poses are measured on any view of a mesh",
        lambda: write_view_set(Path("set/tea"), 1, ring(0, 90, 180, 270)),
    ),
    "bench config": Case(
        f"{BENCH} --config c.toml",
        "c.toml: unknown key 'x'",
        lambda: [text("pairs.csv", "a,b\nbox,box\n")(), config("x=1")()],
    ),
}


def marks(case: Case) -> list[pytest.MarkDecorator]:
    return [pytest.mark.needs_pybullet] if case.simulated else []


def run(typed: str, monkeypatch: pytest.MonkeyPatch) -> object:
    monkeypatch.setattr(sys, "argv", ["viewsep", *typed.split()])
    with pytest.raises(SystemExit) as end:
        main()
    return end.value.code


@pytest.mark.parametrize("case", [pytest.param(case, id=name, marks=marks(case)) for name, case in CASES.items()])
def test_bad_input_ends_in_one_sentence(
    case: Case, workspace: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copytree(workspace, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    case.before()
    before = {path.relative_to(tmp_path) for path in tmp_path.rglob("*")}
    code = run(case.typed, monkeypatch)
    out, err = capsys.readouterr()
    assert err.startswith("viewsep: "), err
    assert len(err.splitlines()) == 1, err
    assert "Traceback" not in err
    assert (code, out) == (2, ""), err
    assert re.search(case.words, err), err
    after = {path.relative_to(tmp_path) for path in tmp_path.rglob("*")}
    assert not [path for path in after if path.suffix == ".part"]
    assert after - before <= {Path("new"), *(path for path in after if path.parent == Path("new"))}


@pytest.mark.parametrize(
    "typed", ["learn", "separate", "separate --models lib --seed -1", "--turn", "turn", "bench separation --runs 0"]
)
def test_a_command_that_does_not_exist_like_this_exits_with_2(
    typed: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(typed, monkeypatch) == 2
    out, err = capsys.readouterr()
    assert out == ""
    assert "Usage: viewsep" in err
    assert "Traceback" not in err


def test_the_workspace_is_good_until_something_is_spoilt(
    workspace: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(workspace)
    monkeypatch.setattr(sys, "argv", ["viewsep", "replay", "run.mcap", "--models", "lib", "--json"])
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 0, capsys.readouterr().err
