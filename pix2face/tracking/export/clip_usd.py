"""Writes a tracked face as USD: a mesh with the points of each frame, a moving head, and the camera.

Time codes are frame numbers, so that the scene can be composited with the clip. Points are in the frame of the head.
"""

from pathlib import Path
from typing import Any

import numpy as np

from pix2face.files.writing import written_in_one_step
from pix2face.geometry.other_cameras import M_PER_MM, ORTHOGRAPHIC_DISTANCE_MM
from pix2face.photographs.usd_files import (
    add_mesh,
    add_orthographic_camera,
    add_perspective_camera,
    film_focal,
    new_stage,
    set_points,
    usd_module,
)
from pix2face.tracking.export.clip_scene import ClipScene, HeadMotion

# Number of frames whose points are kept in memory before they are written.
FRAMES_AT_A_TIME = 64


def write_clip_usd(path: Path, scene: ClipScene) -> None:
    """Writes a scene, in which at least one frame shows the face, as ``.usdc``.

    Raises:
        UsageError: usd-core is not installed.
    """
    with written_in_one_step(path) as unfinished:
        own = unfinished.with_suffix(".part.usdc")  # with the suffix from which USD takes the format
        try:
            _write_stage(own, scene)
            own.replace(unfinished)
        finally:
            own.unlink(missing_ok=True)


def _write_stage(path: Path, scene: ClipScene) -> None:
    stage = new_stage(path, "/clip")
    stage.SetTimeCodesPerSecond(scene.fps)
    stage.SetFramesPerSecond(scene.fps)
    stage.SetStartTimeCode(scene.frames[0])
    stage.SetEndTimeCode(scene.frames[-1])
    motion = scene.motion()
    _add_camera(stage, scene, motion)
    _add_head(stage, scene, motion)
    mesh = add_mesh(stage, "/clip/head/mesh", scene.model)
    neutral, expressions = scene.neutral_vertices(), scene.expressions
    basis = scene.model.expression_basis.reshape(scene.model.n_expression, scene.model.mean.size)
    for index, frame in enumerate(scene.frames):
        if scene.is_there[index]:
            set_points(mesh, (neutral + (expressions[index] @ basis).reshape(-1, 3)) * M_PER_MM, frame)
        if index % FRAMES_AT_A_TIME == 0:
            stage.GetRootLayer().Save()
    stage.GetRootLayer().Save()


def _add_camera(stage: Any, scene: ClipScene, motion: HeadMotion) -> None:
    height, width = scene.size_px
    if motion.focal_px is None:
        assert motion.width_m is not None
        farthest = 2 * ORTHOGRAPHIC_DISTANCE_MM * M_PER_MM
        add_orthographic_camera(stage, "/clip/video", motion.width_m, motion.width_m * height / width, farthest)
        return
    focal = add_perspective_camera(stage, "/clip/video", width / height).CreateFocalLengthAttr()
    for frame, focal_px in zip(scene.frames, motion.focal_px.tolist(), strict=True):
        focal.Set(film_focal(focal_px, width), frame)


def _add_head(stage: Any, scene: ClipScene, motion: HeadMotion) -> None:
    geom, linear = usd_module("UsdGeom"), usd_module("Gf")
    head = geom.Xform.Define(stage, "/clip/head")
    place = head.AddTranslateOp(geom.XformOp.PrecisionDouble)
    turn, size = head.AddOrientOp(geom.XformOp.PrecisionFloat), head.AddScaleOp(geom.XformOp.PrecisionFloat)
    visibility = head.CreateVisibilityAttr()
    quaternions = motion.quaternions.tolist()
    for index, frame in enumerate(scene.frames):
        place.Set(linear.Vec3d(*motion.translations_m[index].tolist()), frame)
        x, y, z, w = quaternions[index]
        turn.Set(linear.Quatf(w, x, y, z), frame)
        size.Set(linear.Vec3f(*np.repeat(motion.scales[index], 3).tolist()), frame)
        if index == 0 or scene.is_there[index] != scene.is_there[index - 1]:
            visibility.Set(geom.Tokens.inherited if scene.is_there[index] else geom.Tokens.invisible, frame)
