"""Reads a dataset with FiftyOne itself, and prints as JSON what it holds: what test_fiftyone_reader.py runs.

FiftyOne keeps all that it reads in a MongoDB, which its package would fetch; here mongomock stands for it, in memory.

    python fiftyone_reader.py FOLDER TYPE FIELD
"""
# pyright: reportMissingImports=false, reportPrivateUsage=false, reportAttributeAccessIssue=false

import json
import os
import sys
from pathlib import Path

os.environ["FIFTYONE_DATABASE_URI"] = "mongodb://localhost"
os.environ["FIFTYONE_DO_NOT_TRACK"] = "1"

import mongoengine
import mongoengine.connection
import mongomock
import pymongo
from mongomock.store import ServerStore

SHARED = ServerStore()


class MemoryClient(mongomock.MongoClient):
    """All clients of this process see the same databases."""

    _closed = False

    def __init__(self, *_: object, **__: object) -> None:
        super().__init__(_store=SHARED)

    def close(self) -> None:
        """Keeps what there is."""


def connect_in_memory() -> None:
    """Before FiftyOne asks for its database."""
    pymongo.MongoClient = mongoengine.connection.MongoClient = MemoryClient
    connect = mongoengine.connect
    mongoengine.connect = lambda name, **_: connect(name, host="mongodb://localhost", mongo_client_class=MemoryClient)
    from fiftyone.core.odm import database

    database._validate_db_version = lambda *_: None  # asks the server for its version


def main() -> None:
    """Reads, and prints samples by the name of their file."""
    folder, kind, field = sys.argv[1:]
    connect_in_memory()
    import fiftyone

    dataset = fiftyone.Dataset.from_dir(dataset_dir=folder, dataset_type=getattr(fiftyone.types, kind), progress=False)
    found = {}
    for sample in dataset:
        detections = sample[field].detections if sample[field] else []
        found[Path(sample.filepath).name] = [
            {
                "label": one.label,
                "bounding_box": one.bounding_box,
                "confidence": one.confidence,
                "index": one.index,
                "mask": None if one.mask is None else one.mask.astype(int).tolist(),
            }
            for one in detections
        ]
    print("SAMPLES " + json.dumps(found))


if __name__ == "__main__":
    main()
