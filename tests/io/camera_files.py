"""Writers of cameras' files, from the published layouts and independent of the readers: for tests and benchmarks."""

from __future__ import annotations

import struct
from pathlib import Path

import numpy as np

CIH = """#Camera Information Header
Date : 2026/2/3
Time : 10:34
Record Rate(fps) : {rate}
Total Frame : {count}
Start Frame : {first}
Save Step : {step}
Image Width : {width}
Image Height : {height}
Color Type : {colour}
Color Bit : {stored}
File Format : MRaw
EffectiveBit Depth : {bits}
EffectiveBit Side : {side}
Comment Text : a : b
END
"""

CIHX = """binary before\0\1 the text
<cih><fileInfo><date>2026/2/3</date><time>10:34</time></fileInfo><recordInfo><recordRate>{rate}</recordRate>
</recordInfo><frameInfo><totalFrame>{count}</totalFrame><startFrame>{first}</startFrame><skipFrame>{step}</skipFrame>
</frameInfo><imageDataInfo><resolution><width>{width}</width><height>{height}</height></resolution><colorInfo>
<type>{colour}</type><bit>{stored}</bit></colorInfo><effectiveBit><depth>{bits}</depth><side>{side}</side></effectiveBit>
</imageDataInfo><imageFileInfo><fileFormat>MRaw</fileFormat></imageFileInfo></cih>
trailing
"""


def packed(values, bits):
    """Integers as a stream of bits, the most significant first; filled up to a whole byte."""
    flat = np.asarray(values).reshape(-1).astype(np.uint32)
    stream = (flat[:, None] >> np.arange(bits - 1, -1, -1)) & 1
    return np.packbits(stream.reshape(-1).astype(np.uint8)).tobytes()


def write_mraw(path, frames, stored, *, xml=False, bits=None, side="Lower", rate=1000, first=0, step=1, colour="Mono"):
    """``path.mraw`` with its header; ``stored`` bits per pixel (of one colour)."""
    path = Path(path)
    path.write_bytes(
        b"".join(
            packed(f, stored) if stored in (10, 12) else np.asarray(f).astype("<u2" if stored == 16 else "u1").tobytes()
            for f in frames
        )
    )
    height, width = frames[0].shape[:2]
    values = {
        "count": len(frames), "width": width, "height": height, "stored": stored * (3 if frames[0].ndim == 3 else 1),
        "bits": bits or stored, "side": side, "rate": rate, "first": first, "step": step, "colour": colour,
    }  # fmt: skip
    header = path.with_suffix(".cihx" if xml else ".cih")
    header.write_text((CIHX if xml else CIH).format(**values), encoding="latin-1")
    return header


def time64(seconds):
    """Fractions (2**-32 s) and whole seconds; the two lowest bits are flags and set, to be ignored."""
    whole = int(seconds)
    return struct.pack("<II", round((seconds - whole) * 2**32) & ~3 | 3, whole)


def write_cine(
    path, frames, stored, *, packing=0, real_bits=None, times=None, trigger_s=0.0, first=0, rate=0, cfa=None,
    compression=0, setup_bytes=1200, annotation=b"", from_top=False, bgr=False,
):  # fmt: skip
    """CINEFILEHEADER, BITMAPINFOHEADER, SETUP, tagged blocks, offsets, images."""
    height, width = frames[0].shape[:2]
    images = []
    for frame in frames:
        if packing:
            images.append(packed(frame, {256: 10, 1024: 12}[packing]))
            continue
        rows = frame if from_top else frame[::-1]
        rows = rows[..., ::-1] if bgr else rows
        images.append(np.ascontiguousarray(rows).astype("<u2" if stored in (16, 48) else "u1").tobytes())
    setup = bytearray(setup_bytes)
    for offset, layout, value in (
        (140, "2s", b"ST"), (142, "<H", setup_bytes), (768, "<I", rate), (808, "<I", cfa or 0),
        (896, "<I", real_bits or stored),
    ):  # fmt: skip
        if offset + struct.calcsize(layout) <= setup_bytes:
            struct.pack_into(layout, setup, offset, value)
    blocks = struct.pack("<IHH", 12, 1000, 0) + b"skip"
    if times is not None:
        blocks += struct.pack("<IHH", 8 + 8 * len(frames), 1002, 0) + b"".join(time64(t) for t in times)
    offsets_at = 44 + 40 + len(setup) + len(blocks)
    place, places, body = offsets_at + 8 * len(frames), [], b""
    for image in images:
        places.append(place + len(body))
        body += struct.pack("<I", 8 + len(annotation)) + annotation + struct.pack("<I", len(image)) + image
    head = struct.pack(
        "<2sHHHiIiIIII", b"CI", 44, 2 if cfa is not None else compression, 1, first, len(frames), first, len(frames),
        44, 84, offsets_at,
    ) + time64(trigger_s)  # fmt: skip
    bitmap = struct.pack(
        "<IiiHHIIiiII", 40, width, -height if from_top else height, 1, stored, packing, len(images[0]), 0, 0, 0, 0
    )
    Path(path).write_bytes(head + bitmap + bytes(setup) + blocks + struct.pack(f"<{len(places)}q", *places) + body)


SPE_TYPES = {"<f4": 0, "<i4": 1, "<i2": 2, "<u2": 3}

SPE_XML = """<?xml version="1.0" encoding="utf-8"?>
<SpeFormat version="3.0" xmlns="http://www.princetoninstruments.com/spe/2009"><DataFormat>
<DataBlock type="Frame" count="{count}" pixelFormat="MonochromeUnsigned16" size="{size}" stride="{stride}">
<DataBlock type="Region" count="1" width="{width}" height="{height}" size="{size}" stride="{size}" /></DataBlock>
</DataFormat><MetaFormat><MetaBlock><FrameTrackingNumber type="Int64" bitDepth="64" />
<TimeStamp event="ExposureStarted" type="Int64" bitDepth="64" resolution="1000000"
 absoluteTime="2026-02-03T10:34:00.5+01:00" /></MetaBlock></MetaFormat></SpeFormat>"""


def write_spe(path, frames, kind="<u2", version=2.5):
    """The header of 4100 bytes and the frames."""
    head = bytearray(4100)
    height, width = frames[0].shape
    for offset, layout, value in (
        (20, "10s", b"03Feb2026"), (42, "<H", width), (108, "<h", SPE_TYPES[kind]), (172, "7s", b"103456"),
        (656, "<H", height), (1446, "<i", len(frames)), (1992, "<f", version), (4098, "<H", 0x5555),
    ):  # fmt: skip
        struct.pack_into(layout, head, offset, value)
    Path(path).write_bytes(bytes(head) + b"".join(np.asarray(f).astype(kind).tobytes() for f in frames))


def write_spe3(path, frames, ticks):
    """Version 3: two 64-bit numbers behind every frame, and the XML footer."""
    head = bytearray(4100)
    height, width = frames[0].shape
    size = 2 * width * height
    body = b"".join(
        np.asarray(f).astype("<u2").tobytes() + struct.pack("<qq", k, t)
        for k, (f, t) in enumerate(zip(frames, ticks, strict=True))
    )
    struct.pack_into("<f", head, 1992, 3.0)
    struct.pack_into("<Q", head, 678, len(head) + len(body))
    xml = SPE_XML.format(count=len(frames), size=size, stride=size + 16, width=width, height=height)
    Path(path).write_bytes(bytes(head) + body + xml.encode())
