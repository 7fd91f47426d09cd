"""Writer and reader of Flashmat's model file (`docs/model-format.md`), in numpy only.

The mirror of `core/src/net/format.rs` and `graph.rs`. Arrays go in and come out in their plain layouts
(convolution weights `[cout][kh][kw][cin]`, channels of the first source before those of the second); packing
for the kernels happens here. `write_model` checks shapes and types, so that the Rust loader takes its files.
"""

from __future__ import annotations

import json
import struct
import zlib
from dataclasses import astuple
from itertools import pairwise
from os import PathLike
from pathlib import Path

import numpy as np

from .graph import (
    CRF_COEFFICIENTS,
    Array,
    Conv,
    Defaults,
    Dense,
    Depthwise,
    Graph,
    Layer,
    MeanPool,
    MixHead,
    Model,
    ModelFileError,
    Pad,
    Source,
    Tensor,
)
from .graph import conv_from_float as conv_from_float
from .graph import depthwise_from_float as depthwise_from_float

MAGIC = b"FLASHMAT"
VERSION = 2
ALIGN = 64
NONE = 0xFFFF_FFFF
CLASS_NAMES = ("fabric", "ground", "leather", "metal", "stone-diff", "stone-spec", "polymer", "wood")
MAP_CHANNELS = {"albedo": 3, "normal": 3, "roughness": 1}
MAP_CODES = {"albedo": 1, "normal": 2, "roughness": 3}
OP_CONV, OP_MEAN_POOL, OP_DENSE, OP_MIX_HEAD, OP_DEPTHWISE = 1, 2, 3, 4, 5
INPUT_CHANNELS = 6
INPUT_SCALE = float(np.float32(1.0) / np.float32(255.0))
INPUT_ZERO_POINT = -128
NAME_BYTES = 32
PANEL = 16  # output channels in one packed panel
GROUP = 4  # consecutive K values in one packed group


def pack_weights(weight_q: Array) -> Array:
    """`[cout][kh][kw][cin]` to `[cout/16][kh][ceil(kw*cin/4)][16][4]`, padded with zeros."""
    cout, kh, kw, cin = weight_q.shape
    panels, groups = -(-cout // PANEL), -(-kw * cin // GROUP)
    padded = np.zeros((panels * PANEL, kh, groups * GROUP), np.int8)
    padded[:cout, :, : kw * cin] = weight_q.reshape(cout, kh, kw * cin)
    split = padded.reshape(panels, PANEL, kh, groups, GROUP)
    return np.ascontiguousarray(split.transpose(0, 2, 3, 1, 4))


def unpack_weights(packed: Array, shape: tuple[int, int, int, int]) -> Array:
    """The inverse of `pack_weights` for weights of that `[cout][kh][kw][cin]`."""
    cout, kh, kw, cin = shape
    panels, groups = -(-cout // PANEL), -(-kw * cin // GROUP)
    split = packed.reshape(panels, kh, groups, PANEL, GROUP).transpose(0, 3, 1, 2, 4)
    rows = split.reshape(panels * PANEL, kh, groups * GROUP)
    return np.ascontiguousarray(rows[:cout, :, : kw * cin]).reshape(shape)


def column_sums(weight_q: Array, source_channels: list[int]) -> Array:
    """i32 `[sources][cout]`: the weights of each source summed over its taps and channels."""
    bounds = np.cumsum([0, *source_channels])
    wide = weight_q.astype(np.int32)
    return np.stack([wide[..., a:b].sum(axis=(1, 2, 3)) for a, b in pairwise(bounds)]).astype(np.int32)


class _Section:
    """Bytes of one section; arrays start on 64-byte boundaries within it."""

    def __init__(self) -> None:
        self.data = bytearray()

    def add(self, array: Array, dtype: str) -> int:
        self.data += bytes(-len(self.data) % ALIGN)
        offset = len(self.data)
        self.data += np.ascontiguousarray(array, dtype=dtype).tobytes()
        return offset


def _require(condition: bool, message: str) -> None:
    if not condition:
        raise ModelFileError(message)


def _name_bytes(name: str) -> bytes:
    data = name.encode("ascii")
    _require(0 < len(data) <= NAME_BYTES, f"name {name!r} must have 1 to {NAME_BYTES} ASCII characters")
    return data.ljust(NAME_BYTES, b"\0")


def _source_fields(graph: Graph, ids: dict[str, int], sources: tuple[Source, ...]) -> list[int]:
    _require(1 <= len(sources) <= 2, "a layer reads one or two sources")
    fields: list[int] = []
    for source in sources:
        _require(source.tensor in ids, f"unknown tensor {source.tensor!r}")
        _require(graph.tensor(source.tensor).divisor > 0, f"{source.tensor!r} is a vector, not an image")
        fields += [ids[source.tensor], int(source.upsample)]
    return fields if len(sources) == 2 else [*fields, NONE, 0]


def _layer_record(graph: Graph, ids: dict[str, int], layer: Layer, sections: dict[str, _Section]) -> bytes:
    """One 160-byte record: 32 u32 fields, then the name."""
    weights, params, floats = sections["WGT8"], sections["PARM"], sections["WGTF"]
    fields = [0] * 32
    fields[3] = NONE
    if isinstance(layer, Conv | MixHead):
        fields[1:5] = _source_fields(graph, ids, layer.sources)
        channels = [graph.tensor(s.tensor).channels for s in layer.sources]
        cout, kh, kw, cin = (layer.weight_q if isinstance(layer, Conv) else layer.weight[0]).shape
        _require(cin == sum(channels), f"{layer.name}: weights read {cin} channels, sources have {sum(channels)}")
        fields[6:8] = [kh, kw]
        fields[9:13] = layer.pad
        fields[17] = cout
    elif isinstance(layer, Depthwise):
        fields[1:5] = _source_fields(graph, ids, (Source(layer.source),))
        kh, kw, cout = layer.weight_q.shape
        _require(graph.tensor(layer.source).channels == cout, f"{layer.name}: one kernel per channel of its source")
        fields[6:8] = [kh, kw]
        fields[9:13] = layer.pad
        fields[17] = cout
    elif isinstance(layer, MeanPool):
        pair = _source_fields(graph, ids, tuple(Source(s) for s in layer.sources))
        fields[1], fields[3] = pair[0], pair[2]
        count = sum(graph.tensor(s).channels for s in layer.sources)
        _require(count == graph.tensor(layer.output).channels, f"{layer.name}: one mean per channel of its sources")
    else:
        _require(1 <= len(layer.sources) <= 2, f"{layer.name}: a layer reads one or two sources")
        for field, source in zip((1, 3), layer.sources, strict=False):
            fields[field] = ids[source]
    if isinstance(layer, Conv | Depthwise):
        _require(
            layer.weight_q.dtype == np.int8 and int(layer.weight_q.min()) >= -127,
            f"{layer.name}: weights in [-127, 127]",
        )
        _require(
            layer.bias_q.dtype == np.int32 and layer.bias_q.shape == (cout,),
            f"{layer.name}: i32 bias per channel",
        )
        _require(layer.weight_scale.shape == (cout,), f"{layer.name}: one weight scale per channel")
        _require(graph.tensor(layer.output).channels == cout, f"{layer.name}: output has other channels")
        dense = isinstance(layer, Conv)
        fields[0] = OP_CONV if dense else OP_DEPTHWISE
        fields[5], fields[8], fields[13] = ids[layer.output], layer.stride, 2 * layer.relu6 or int(layer.relu)
        fields[18] = weights.add(pack_weights(layer.weight_q) if dense else layer.weight_q, "<i1")
        fields[19] = params.add(layer.bias_q, "<i4")
        fields[20] = params.add(layer.weight_scale, "<f4")
        if dense:
            fields[21] = params.add(column_sums(layer.weight_q, channels), "<i4")
        fields[22] = fields[23] = NONE
        if layer.weight is not None and layer.bias is not None:
            _require(layer.weight.shape == layer.weight_q.shape, f"{layer.name}: float weights of another shape")
            fields[22], fields[23] = floats.add(layer.weight, "<f4"), floats.add(layer.bias, "<f4")
    elif isinstance(layer, MeanPool):
        fields[0], fields[5] = OP_MEAN_POOL, ids[layer.output]
        fields[17] = graph.tensor(layer.output).channels
    elif isinstance(layer, Dense):
        inputs = sum(graph.tensor(source).channels for source in layer.sources)
        shape = (graph.tensor(layer.output).channels, inputs)
        _require(
            layer.weight.shape == shape and layer.bias.shape == shape[:1],
            f"{layer.name}: weights must be {shape}",
        )
        fields[0], fields[5], fields[13], fields[17] = OP_DENSE, ids[layer.output], int(layer.relu), shape[0]
        fields[18], fields[19] = params.add(layer.weight, "<f4"), params.add(layer.bias, "<f4")
    else:
        _require(layer.map in MAP_CODES, f"{layer.name}: no map named {layer.map!r}")
        _require(cout == MAP_CHANNELS[layer.map] * layer.shuffle**2, f"{layer.name}: N * r * r channels expected")
        classes = layer.weight.shape[0]
        _require(classes in (1, 8), f"{layer.name}: one or eight sets of weights")
        _require(layer.bias.shape == (classes, cout), f"{layer.name}: one bias per set and channel")
        fields[0], fields[5], fields[8] = OP_MIX_HEAD, NONE, 1
        fields[14], fields[15], fields[16] = layer.shuffle, MAP_CODES[layer.map], classes
        fields[18], fields[19] = params.add(layer.weight, "<f4"), params.add(layer.bias, "<f4")
    return struct.pack("<32I", *fields) + _name_bytes(layer.name)


def _graph_bytes(graph: Graph, sections: dict[str, _Section]) -> bytes:
    ids = {tensor.name: index for index, tensor in enumerate(graph.tensors)}
    _require(len(ids) == len(graph.tensors), "tensor names must differ")
    _require(graph.logits in ids and graph.tensor(graph.logits).channels == 8, "the logits tensor is a vector of 8")
    first = graph.tensors[0]
    _require(
        graph.input == first.name
        and (first.channels, first.divisor, first.zero_point) == (INPUT_CHANNELS, 1, INPUT_ZERO_POINT)
        and np.float32(first.scale) == np.float32(INPUT_SCALE),
        "tensor 0 is the input: 6 channels, divisor 1, scale 1/255, zero point -128",
    )
    data = struct.pack("<4I", len(graph.tensors), len(graph.layers), ids[graph.input], ids[graph.logits])
    for tensor in graph.tensors:
        data += struct.pack("<2IfiQQ", tensor.channels, tensor.divisor, tensor.scale, tensor.zero_point, 0, 0)
        data += _name_bytes(tensor.name)
    for layer in graph.layers:
        data += _layer_record(graph, ids, layer, sections)
    return data


def model_bytes(model: Model) -> bytes:
    """The file's bytes."""
    work = {kind: _Section() for kind in ("WGT8", "PARM", "WGTF")}
    graph = _graph_bytes(model.graph, work)
    crf = np.asarray(model.crf, np.float32)
    _require(
        crf.shape == (8, CRF_COEFFICIENTS) and bool(np.isfinite(crf).all()),
        "CRF coefficients are 8 x 12 finite floats",
    )
    defaults = model.defaults
    sections = {
        "META": json.dumps(model.meta, sort_keys=True).encode(),
        "GRPH": graph,
        "WGT8": bytes(work["WGT8"].data),
        "PARM": bytes(work["PARM"].data),
        "CRFC": crf.astype("<f4").tobytes(),
        "DFLT": struct.pack("<4f2I", *astuple(defaults))[: 24 if defaults.top_size else 20],
        "CARD": model.card.encode(),
    }
    if work["WGTF"].data:
        sections["WGTF"] = bytes(work["WGTF"].data)
    table, body = b"", b""
    start = ALIGN + 32 * len(sections)
    for kind, data in sections.items():
        body += bytes(-(start + len(body)) % ALIGN)
        table += struct.pack("<4sIQQQ", kind.encode(), 0, start + len(body), len(data), 0)
        body += data
    payload = table + body
    length = ALIGN + len(payload)
    header = struct.pack("<8sIIQI", MAGIC, VERSION, len(sections), length, zlib.crc32(payload))
    return header.ljust(ALIGN, b"\0") + payload


def write_model(path: str | PathLike[str], model: Model) -> None:
    """Writes the model file."""
    Path(path).write_bytes(model_bytes(model))


def read_model(path: str | PathLike[str]) -> Model:
    """Reads a model file back; raises `ModelFileError` when it is not one."""
    return parse_model(Path(path).read_bytes())


def _sections(data: bytes) -> dict[str, bytes]:
    _require(len(data) >= ALIGN and data[:8] == MAGIC, "not a Flashmat model file")
    version, count, length, crc = struct.unpack_from("<IIQI", data, 8)
    _require(version == VERSION, f"version {version}; this reader knows {VERSION}")
    _require(length == len(data), f"the file has {len(data)} bytes, its header says {length}")
    _require(zlib.crc32(data[ALIGN:]) == crc, "checksum differs: the file is damaged")
    sections = {}
    for index in range(count):
        kind, _, offset, size, _ = struct.unpack_from("<4sIQQQ", data, ALIGN + 32 * index)
        _require(offset + size <= len(data), f"section {kind!r} ends beyond the file")
        sections[kind.decode("ascii")] = data[offset : offset + size]
    return sections


def _floats(section: bytes, offset: int, shape: tuple[int, ...], dtype: str = "<f4") -> Array:
    count = int(np.prod(shape))
    return np.frombuffer(section, dtype, count, offset).reshape(shape).astype(dtype[1:])


def _parse_layer(sections: dict[str, bytes], tensors: list[Tensor], record: bytes) -> Layer:
    fields = struct.unpack_from("<32I", record)
    name = record[128:].rstrip(b"\0").decode("ascii")
    pairs = [(fields[1], fields[2]), (fields[3], fields[4])]
    sources = tuple(Source(tensors[t].name, bool(up)) for t, up in pairs if t != NONE)
    cin = sum(tensors[t].channels for t, _ in pairs if t != NONE)
    op, cout, (kh, kw) = fields[0], fields[17], fields[6:8]
    pad: Pad = (fields[9], fields[10], fields[11], fields[12])
    params = sections["PARM"]
    if op in (OP_CONV, OP_DEPTHWISE):
        shape = (cout, kh, kw, cin) if op == OP_CONV else (kh, kw, cout)
        count = -(-cout // PANEL) * kh * -(-kw * cin // GROUP) * PANEL * GROUP if op == OP_CONV else kh * kw * cout
        codes = np.frombuffer(sections["WGT8"], np.int8, count, fields[18])
        has_float = fields[22] != NONE
        rest = (
            _floats(params, fields[20], (cout,)),
            _floats(params, fields[19], (cout,), "<i4"),
            fields[8],
            pad,
            bool(fields[13]),
            _floats(sections["WGTF"], fields[22], shape) if has_float else None,
            _floats(sections["WGTF"], fields[23], (cout,)) if has_float else None,
            fields[13] == 2,
        )
        output = tensors[fields[5]].name
        if op == OP_CONV:
            return Conv(name, sources, output, unpack_weights(codes, shape), *rest)
        return Depthwise(name, sources[0].tensor, output, codes.reshape(shape).copy(), *rest)
    if op == OP_MEAN_POOL:
        return MeanPool(name, tuple(s.tensor for s in sources), tensors[fields[5]].name)
    if op == OP_DENSE:
        weight = _floats(params, fields[18], (cout, cin))
        return Dense(
            name,
            tuple(s.tensor for s in sources),
            tensors[fields[5]].name,
            weight,
            _floats(params, fields[19], (cout,)),
            bool(fields[13]),
        )
    _require(op == OP_MIX_HEAD, f"{name}: unknown op {op}")
    kind = next((map_name for map_name, code in MAP_CODES.items() if code == fields[15]), "")
    classes = fields[16]
    weight = _floats(params, fields[18], (classes, cout, kh, kw, cin))
    return MixHead(name, sources, kind, fields[14], weight, _floats(params, fields[19], (classes, cout)), pad)


def parse_model(data: bytes) -> Model:
    """A model from a file's bytes."""
    sections = _sections(data)
    graph = sections["GRPH"]
    tensor_count, layer_count, input_id, logits_id = struct.unpack_from("<4I", graph)
    tensors = []
    for index in range(tensor_count):
        at = 16 + 64 * index
        channels, divisor, scale, zero_point = struct.unpack_from("<2Ifi", graph, at)
        tensors.append(
            Tensor(graph[at + 32 : at + 64].rstrip(b"\0").decode("ascii"), channels, divisor, scale, zero_point)
        )
    base = 16 + 64 * tensor_count
    layers = [_parse_layer(sections, tensors, graph[base + 160 * i : base + 160 * (i + 1)]) for i in range(layer_count)]
    return Model(
        json.loads(sections["META"]),
        Graph(tensors, layers, tensors[input_id].name, tensors[logits_id].name),
        _floats(sections["CRFC"], 0, (8, CRF_COEFFICIENTS)),
        Defaults(*struct.unpack("<4f2I", sections["DFLT"].ljust(24, b"\0"))),
        sections["CARD"].decode(),
    )
