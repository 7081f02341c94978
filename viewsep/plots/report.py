"""One picture of one separation task, drawn from its recording: what was seen, believed, planned and concluded."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from textwrap import shorten

import numpy as np
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.gridspec import GridSpec
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from viewsep.assembly import make_engine
from viewsep.config import Config
from viewsep.engine.state import EngineState
from viewsep.geometry import angle_between, delaunay_edges
from viewsep.interfaces import Interpretation, Interpreter
from viewsep.interpretation.hypotheses import path_elements
from viewsep.interpretation.interpreter import PathInterpreter, PathState
from viewsep.messages import Array, FloatArray, Outcome, Percept, PerceptReceived, Phase
from viewsep.models.aspect_graph import AspectGraph
from viewsep.planning.separating_view import similarity_graph
from viewsep.plots import sphere
from viewsep.plots.contact_sheet import write_png
from viewsep.plots.sphere import SphereView
from viewsep.recordings.codec import RecordedFrame
from viewsep.recordings.reader import Recording
from viewsep.recordings.replay import replay, restore

WIDTH_IN, HEIGHT_IN, DPI = 16.0, 12.0, 100
SPHERES = 4  # candidates with a sphere and a colour of their own
RED = "#D55E00"  # the paper's colour for the controlled path; all colours after Okabe and Ito
COLOURS = ("#0072B2", "#E69F00", "#009E73", "#CC79A7")
OTHERS, MARK = "0.6", "#F0E442"
STYLES = ("-", "--", "-.", (0, (1, 1)))
PHASES = {Phase.EXPLORING: "1.0", Phase.APPROACHING: "0.94", Phase.JUDGING: "0.86"}
VALUES = colormaps["cividis"]
