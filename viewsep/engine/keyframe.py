"""The engine's state as bytes, so that a replay can begin in the middle.

Arrays keep their type, shape and memory order, because the last bit of a sum may depend on the order.
"""

from __future__ import annotations

from typing import Any, get_origin

import numpy as np
from cattrs import Converter
from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override
from cattrs.preconf.msgpack import make_converter
from msgpack import packb, unpackb

from viewsep.engine.state import EngineState
from viewsep.errors import BadInput
from viewsep.messages import Array


class StateCodec:
    """Engine states to bytes and back, for one type of interpreter state and one of planner state."""

    def __init__(self, interpretation: type, planning: type) -> None:
        self._converter = converter = make_converter()
        converter.register_structure_hook_func(_is_array, lambda kept, _type: _array(kept))
        converter.register_unstructure_hook_func(_is_array, _kept)
        converter.register_unstructure_hook(np.ndarray, _kept)
        plugin_states = {
            "interpretation": _optional(converter, interpretation),
            "planning": _optional(converter, planning),
        }
        converter.register_structure_hook(EngineState, make_dict_structure_fn(EngineState, converter, **plugin_states))
        converter.register_unstructure_hook(
            EngineState, make_dict_unstructure_fn(EngineState, converter, **plugin_states)
        )

    def to_bytes(self, state: EngineState) -> bytes:
        """`state` as MessagePack; equal states give equal bytes."""
        packed: bytes = packb(self._converter.unstructure(state, EngineState))
        return packed

    def same(self, state: EngineState, data: bytes) -> bool:
        """Whether `data` says the same as `state`, as far as the version that wrote it knew. Raises BadInput."""
        before = self.from_bytes(data)
        known = unpackb(data, strict_map_key=False)
        ours, theirs = (unpackb(self.to_bytes(one), strict_map_key=False) for one in (state, before))
        return bool(packb(_known(ours, known)) == packb(_known(theirs, known)))

    def from_bytes(self, data: bytes) -> EngineState:
        """The state that `to_bytes` made `data` of. Raises BadInput when it is of another interpreter or planner."""
        try:
            state: EngineState = self._converter.structure(unpackb(data, strict_map_key=False), EngineState)
        except Exception as error:  # cattrs and msgpack raise many kinds, all of them for what the bytes hold
            raise BadInput(
                f"an engine state of {len(data)} bytes does not fit this interpreter and planner ({error}): replay "
                "with those it was recorded with"
            ) from error
        return state


def _known(told: Any, known: Any) -> Any:
    """Of nested dictionaries only the keys that `known` has, too."""
    if not (isinstance(told, dict) and isinstance(known, dict)):
        return told
    return {key: _known(value, known[key]) for key, value in told.items() if key in known}


def _optional(converter: Converter, kind: type) -> Any:
    """A plug-in's state, typed as Any in EngineState, or None before a task."""
    return override(
        struct_hook=lambda kept, _type: None if kept is None else converter.structure(kept, kind),
        unstruct_hook=lambda state: None if state is None else converter.unstructure(state, kind),
    )


def _is_array(kind: Any) -> bool:
    return get_origin(kind) is np.ndarray or kind is np.ndarray


def _kept(array: Array) -> tuple[str, tuple[int, ...], bool, bytes]:
    """Type, shape, whether columns come first in memory, and the numbers."""
    by_columns = array.flags.f_contiguous and not array.flags.c_contiguous
    return array.dtype.str, array.shape, by_columns, array.tobytes("F" if by_columns else "C")


def _array(kept: tuple[str, tuple[int, ...], bool, bytes]) -> Array:
    dtype, shape, by_columns, data = kept
    return np.frombuffer(bytearray(data), dtype).reshape(shape, order="F" if by_columns else "C")
