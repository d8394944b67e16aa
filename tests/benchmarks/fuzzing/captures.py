"""Captures in every format, their point clouds and images, and the capture that a project stores."""

from __future__ import annotations

import json
import struct
from dataclasses import replace
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
from capture_samples import room, walk, write_colmap, write_kapture, write_nerfstudio
from PIL import Image

from fuzzing.places import workshop
from fuzzing.reader import Files, Reader, Seed, each, files_in
from nvsim.capture.check import check
from nvsim.capture.findings import Findings
from nvsim.capture.images import decode, image_size
from nvsim.capture.pointcloud import read_cloud
from nvsim.capture.read import read
from nvsim.capture.store import fingerprint, load_capture, save_capture
from nvsim.capture.types import Alignment
from nvsim.footage.position_logs import exif_position, read_log
from nvsim.perception.segment import read_mask

_FRAMES, _POINTS = 4, 60


def readers() -> list[Reader]:
    return [
        Reader("transforms.json", _transforms, _listed, share=4),
        Reader("colmap text", lambda: _colmap(False), _listed, share=4),
        Reader("colmap binary", lambda: _colmap(True), _listed, share=4),
        Reader("kapture", _kapture, _listed, share=4),
        Reader("captures list", _several, _listed, share=2),
        Reader("colmap rigs", _rigs, _listed, share=2),
        Reader("several colmap models", _models, _listed),
        Reader("blender split", _blender, _listed),
        Reader("capture checked", _every, _checked, share=3),
        Reader("cloud", _clouds, _cloud, share=2),
        Reader("image", _images, _image, share=2),
        Reader("image of a frame", _frame_images, _checked),
        Reader("floor mask", _masks, _mask),
        Reader("stored capture", _stored, _load, share=2),
        Reader("position log", _logs, _positions, share=2),
    ]


def _listed(path: Path) -> object:
    """Reads files as an import does. The alignment is given, because estimating it takes ten times as long."""
    return read(path, alignment=Alignment(np.eye(3), 1.0, True))


def _checked(path: Path) -> object:
    """Reads files as `nvsim check` and `nvsim import` do. The check reports problems and never raises."""
    check(path)
    return read(path, scale=1.0)


def _every() -> list[Seed]:
    return [*_transforms(), *_colmap(False), *_colmap(True), *_kapture(), *_several()]


def _walk() -> tuple[np.ndarray, np.ndarray]:
    return walk(_FRAMES), room(_POINTS)


def _transforms() -> list[Seed]:
    with workshop() as folder:
        write_nerfstudio(folder, *_walk(), applied_transform=np.eye(4)[:3].tolist(), k1=0.01)
        plain = files_in(folder)
        tree = json.loads(plain["transforms.json"])
        lens = {k: tree.pop(k) for k in ("fl_x", "fl_y", "cx", "cy", "w", "h", "camera_model")}
        tree["frames"] = [{**frame, **lens} for frame in tree["frames"]]
        own = {**plain, "transforms.json": json.dumps(tree).encode()}
    return [Seed(files, "transforms.json", "transforms.json", "json") for files in (plain, own)]


def _colmap(binary: bool) -> list[Seed]:
    with workshop() as folder:
        write_colmap(folder, *_walk(), binary=binary)
        files = files_in(folder)
    kind, form = ("bin", "binary") if binary else ("txt", "text")
    targets = {f"sparse/0/{name}.{kind}": form for name in ("cameras", "images", "points3D")}
    return each(files, "", targets)


def _kapture() -> list[Seed]:
    with workshop() as folder:
        write_kapture(folder, *_walk(), rig=np.eye(4))
        files = files_in(folder)
    return each(files, "", {name: "text" for name in files if name.endswith(".txt")})


def _several() -> list[Seed]:
    text = b"# both\na\nb  # the second\n"
    seeds = []
    for name, write in (("transforms.json", write_nerfstudio), ("sparse/0/images.bin", write_colmap)):
        more = {"binary": True} if write is write_colmap else {}
        with workshop() as folder:
            write(folder / "a", *_walk(), **more)
            write(folder / "b", *_walk(), **more)
            files = {**files_in(folder), "two.captures": text}
        form = "json" if name.endswith("json") else "binary"
        seeds += each(files, "two.captures", {"two.captures": "text", f"a/{name}": form})
    return seeds


def _rigs() -> list[Seed]:
    """Models of COLMAP 3.12 and later: a rig of one camera with a frame for each image, as text and as binary."""
    seeds = []
    for binary in (False, True):
        files = dict(_colmap(binary)[0].files)
        kind, form = ("bin", "binary") if binary else ("txt", "text")
        files[f"sparse/0/rigs.{kind}"] = struct.pack("<QIIiI", 1, 1, 1, 0, 1) if binary else b"# rigs\n1 1 CAMERA 1\n"
        frames = struct.pack("<Q", _FRAMES) if binary else b"# frames\n"
        for k in range(1, _FRAMES + 1):
            pose = (1.0, 0.0, 0.0, 0.0, 0.1 * k, 0.0, 0.0)
            if binary:
                frames += struct.pack("<II7dIiIQ", k, 1, *pose, 1, 0, 1, k)
            else:
                frames += f"{k} 1 {' '.join(map(str, pose))} 1 CAMERA 1 {k}\n".encode()
        files[f"sparse/0/frames.{kind}"] = frames
        seeds += each(files, "", {f"sparse/0/{name}.{kind}": form for name in ("rigs", "frames")})
    return seeds


def _models() -> list[Seed]:
    """Two models side by side, and a point cloud in its own file next to one of them."""
    seed = _colmap(True)[0]
    files = {n.replace("sparse/0", "sparse/1"): d for n, d in seed.files.items() if n.startswith("sparse/")}
    files |= {**seed.files, "sparse/0/points3D.ply": cloud_samples()["binary_little_endian.ply"]}
    return each(files, "", {"sparse/1/images.bin": "binary", "sparse/0/points3D.ply": "headed"})


def _blender() -> list[Seed]:
    """The three files of NeRF's synthetic captures."""
    poses = _walk()[0]
    files: Files = dict(_transforms()[0].files)
    del files["transforms.json"]
    names = sorted(n for n in files if n.startswith("images/"))
    for split, rows in (("train", range(2)), ("val", range(2, 3)), ("test", range(3, _FRAMES))):
        frames = [
            {"file_path": f"./{names[k].removesuffix('.png')}", "transform_matrix": poses[k].tolist()} for k in rows
        ]
        files[f"transforms_{split}.json"] = json.dumps({"camera_angle_x": 0.7, "frames": frames}).encode()
    seeds = each(files, "", {f"transforms_{split}.json": "json" for split in ("train", "test")})
    return [replace(seed, readable=False) for seed in seeds]


def _clouds() -> list[Seed]:
    return [_one(name, data) for name, data in cloud_samples().items()]


def cloud_samples() -> Files:
    """PLY and PCD in every form that the readers support."""
    points = _walk()[1]
    rows = np.column_stack([points, np.full((len(points), 3), 128)])
    found: Files = {}
    for form in ("ascii", "binary_little_endian", "binary_big_endian"):
        head = f"ply\nformat {form} 1.0\ncomment x\nelement vertex {len(rows)}\n"
        head += "".join(f"property float {n}\n" for n in "xyz")
        head += "".join(f"property uchar {n}\n" for n in ("red", "green", "blue")) + "end_header\n"
        found[f"{form}.ply"] = head.encode() + _rows(rows, form)
    head = "ply\nformat ascii 1.0\nelement vertex 2\nproperty double x\nproperty double y\nproperty double z\n"
    head += "element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 1 1\n3 0 1 0\n"
    found["faces.ply"] = head.encode()
    for data in ("ascii", "binary", "binary_compressed"):
        found[f"{data}.pcd"] = _pcd(points, data)
    return found


def _rows(rows: np.ndarray, form: str) -> bytes:
    if form == "ascii":
        return "".join(" ".join(map(str, [*r[:3], *map(int, r[3:])])) + "\n" for r in rows.tolist()).encode()
    order = "<" if "little" in form else ">"
    kind = np.dtype([(n, f"{order}f4") for n in "xyz"] + [(n, "u1") for n in "rgb"])
    return np.array([tuple(r) for r in rows.tolist()], kind).tobytes()


def _pcd(points: np.ndarray, data: str) -> bytes:
    head = "# .PCD v0.7\nVERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
    head += f"WIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(points)}\nDATA {data}\n"
    columns = [points[:, k].astype("<f4") for k in range(3)] + [np.full(len(points), 0x808080, "<u4")]
    if data == "ascii":
        rows = zip(*(c.tolist() for c in columns), strict=True)
        return head.encode() + "".join(" ".join(map(str, row)) + "\n" for row in rows).encode()
    if data == "binary":
        kind = np.dtype([("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("c", "<u4")])
        return head.encode() + np.array(list(zip(*columns, strict=True)), kind).tobytes()
    # Runs of literals are a valid LZF stream.
    raw = b"".join(c.tobytes() for c in columns)
    packed = b"".join(bytes([len(raw[i : i + 32]) - 1]) + raw[i : i + 32] for i in range(0, len(raw), 32))
    sizes = len(packed).to_bytes(4, "little") + len(raw).to_bytes(4, "little")
    return head.encode() + sizes + packed


def _one(name: str, data: bytes, form: str = "headed") -> Seed:
    return Seed({name: data}, name, name, form)


def _cloud(path: Path) -> object:
    return read_cloud(path, Findings())


def _encoded() -> Files:
    ramp = np.add.outer(np.arange(24), np.arange(32)).astype(np.uint8) * 4
    color = np.dstack([ramp, ramp[::-1], 255 - ramp])
    suffixes = (".png", ".jpg", ".webp", ".bmp", ".tiff", ".ppm", ".pgm", ".exr", ".hdr", ".gif", ".jp2")
    found: Files = {}
    for suffix in suffixes:
        image = color.astype(np.float32) / 255 if suffix in (".exr", ".hdr") else color
        try:
            done, data = cv2.imencode(suffix, ramp if suffix == ".pgm" else image)
        except cv2.error:
            continue
        if done:
            found[f"image{suffix}"] = data.tobytes()
    found["deep.png"] = cv2.imencode(".png", color.astype(np.uint16) * 256)[1].tobytes()
    found["stripes.jpg"] = cv2.imencode(".jpg", color, [cv2.IMWRITE_JPEG_PROGRESSIVE, 1])[1].tobytes()
    return found


def _images() -> list[Seed]:
    files = _encoded()
    common = [n for n in files if n.endswith((".png", ".jpg"))]
    rare = (".exr", ".hdr", ".gif", ".jp2")  # refused or read, depending on the build of the decoder
    return [Seed({n: files[n]}, n, n, "picture", readable=not n.endswith(rare)) for n in [*files, *common * 3]]


def _image(path: Path) -> object:
    image_size(path)
    return decode(path).shape


def _frame_images() -> list[Seed]:
    with workshop() as folder:
        write_nerfstudio(folder, *_walk())
        files = files_in(folder)
    return [Seed(files, "images/001.png", "", "picture"), Seed(files, "cloud.ply", "", "headed")]


def _masks() -> list[Seed]:
    mask = np.zeros((24, 32), np.uint8)
    mask[12:] = 255
    flat = cv2.imencode(".png", mask, [cv2.IMWRITE_PNG_BILEVEL, 1])[1].tobytes()
    return [_one("000000.png", flat, "picture"), _one("000000.png", cv2.imencode(".png", mask)[1].tobytes(), "picture")]


def _mask(path: Path) -> object:
    return read_mask(path, 16, 12).mean(), read_mask(path).mean()


def _stored() -> list[Seed]:
    with workshop() as folder:
        save_capture(read(write_nerfstudio(folder / "walk", *_walk())), folder / "kept")
        files = files_in(folder / "kept")
    cloud = next(n for n in files if n.endswith(".npz"))
    return [*each(files, "", {"capture.json": "json"}) * 2, *each(files, "", {cloud: "zip"})]


def _load(path: Path) -> object:
    capture = load_capture(path)
    return fingerprint(capture), capture.positions


def _logs() -> list[Seed]:
    """Camera positions: from ARKit, a GPS track, subtitles of a drone, and GPS of a photo."""
    places = [(0.1 * k, 1.4, -0.2 * k) for k in range(6)]
    lines = [f"{k / 30}, {k:06d}, {x}, {y}, {z}, 0, 0, 0, 1\n" for k, (x, y, z) in enumerate(places)]
    track, subtitles = "", ""
    for k in range(6):
        track += f'<trkpt lat="48.{k}" lon="-11.5"><ele>5</ele><time>2026-05-01T10:00:0{k}Z</time></trkpt>'
        subtitles += f"{k}\n00:00:0{k},000 --> 00:00:0{k},033\n[latitude: 48.{k}] [longitude: -11.5] [abs_alt: 5.0]\n\n"
    exif = Image.Exif()
    exif.get_ifd(0x8825).update({1: "N", 2: (48.0, 7.0, 30.5), 3: "E", 4: (11.0, 30.0, 0.0), 31: 4.7})
    photograph = BytesIO()
    Image.new("RGB", (32, 24)).save(photograph, "JPEG", exif=exif)
    return [
        _one("odometry.csv", ("timestamp, frame, x, y, z, qx, qy, qz, qw\n" + "".join(lines)).encode(), "text"),
        _one("walk.gpx", f"<?xml version='1.0'?><gpx><trk><trkseg>{track}</trkseg></trk></gpx>".encode(), "text"),
        _one("walk.srt", subtitles.encode(), "text"),
        _one("photograph.jpg", photograph.getvalue(), "picture"),
    ]


def _positions(path: Path) -> object:
    return exif_position(path) if path.suffix == ".jpg" else read_log(path).places
