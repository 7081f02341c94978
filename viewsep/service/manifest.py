"""What a service offers: keys, encodings, schemas, requests and versions."""

from __future__ import annotations

import base64
import json
from collections.abc import Sequence
from typing import Any

from google.protobuf.message import Message as Protobuf
from mcap_protobuf.schema import build_file_descriptor_set

from viewsep.recordings.build import this_build
from viewsep.service.names import JSON, MANIFEST_SCHEMA, PUBLISHED, Keys, Role, encoding
from viewsep.service.requests import REQUESTS
from viewsep.service.status import Status


def manifest(keys: Keys, images: Sequence[str]) -> bytes:
    """The manifest, schema `viewsep.manifest/1`. Protobuf schemas are base64 of a FileDescriptorSet.

    `images` are the endpoints where the pictures of the role that answers are to be had, none where it has none.
    """
    said: dict[str, Any] = {
        "schema": MANIFEST_SCHEMA,
        "name": keys.rig,
        "build": this_build(),
        "queries": {
            keys.status: {"encoding": JSON, "reply": Status.model_json_schema(by_alias=True)},
            keys.manifest: {"encoding": JSON},
            **{
                keys.command(name): {"encoding": JSON, "request": kind.model_json_schema()}
                for name, kind in REQUESTS.items()
            },
        },
        "streams": {
            keys.key(topic): {"encoding": encoding(topic), "file_descriptor_set": _schema(schema)}
            for topic, schema in PUBLISHED.items()
        },
        "images": list(images),
        "liveliness": [keys.alive(role) for role in Role],
        "attachment": "little-endian: sequence number on the key (uint64), ns on the rig's clock (int64)",
    }
    return json.dumps(said).encode()


def _schema(schema: type[Protobuf]) -> str:
    descriptors = build_file_descriptor_set(schema)
    return base64.b64encode(descriptors.SerializeToString(deterministic=True)).decode()
