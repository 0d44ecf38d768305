"""A USD stage that is being filled: surfaces, motion and materials, in metres with z up."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from sim.errors import FieldError
from sim.report.creases import creased
from sim.world.camera.viewpoint import Viewpoint
from sim.world.optional import optional_module

FRAMES_PER_S = 24.0
"""Time codes in a second: the number that renderers take where they do not ask."""
FOCAL_LENGTH = 0.5
"""The camera's, 50 mm: USD has it, and the size of the film, in tenths of the stage's unit."""
NEAR_M, FAR_M = 0.01, 100.0
SKY = 0.5
"""Light from everywhere."""
SUNS = {"Key": (1.1, (35.0, 25.0, 0.0)), "Fill": (0.4, (40.0, -50.0, 0.0)), "Back": (0.3, (-50.0, 0.0, 0.0))}
"""Light from afar: how strong, and how it is turned about x and y from straight down [degrees]."""

Colour = tuple[float, float, float, float]


class Stage:
    """A stage of Pixar's library, whose prims are returned as the library has them."""

    def __init__(self, text: str, duration_s: float) -> None:
        """Begin a stage of some duration; `text` tells what it shows.

        Raises:
            MissingPackageError: Pixar's library is not installed.
        """
        names = ("Gf", "Sdf", "Tf", "Usd", "UsdGeom", "UsdLux", "UsdShade", "Vt")
        pxr = {name: optional_module(f"pxr.{name}", "usd", "`usd`") for name in names}
        self.geom, self.kinds, self._gf = pxr["UsdGeom"], pxr["Sdf"].ValueTypeNames, pxr["Gf"]
        self._lux, self._shade, self._vt, self._tf = pxr["UsdLux"], pxr["UsdShade"], pxr["Vt"], pxr["Tf"]
        self.usd = pxr["Usd"].Stage.CreateInMemory()
        self.geom.SetStageUpAxis(self.usd, self.geom.Tokens.z)
        self.geom.SetStageMetersPerUnit(self.usd, 1.0)
        self.usd.SetTimeCodesPerSecond(FRAMES_PER_S)
        self.usd.SetFramesPerSecond(FRAMES_PER_S)
        self.usd.SetStartTimeCode(0.0)
        self.usd.SetEndTimeCode(FRAMES_PER_S * duration_s)
        self.world = self.geom.Xform.Define(self.usd, "/World").GetPrim()
        self.world.SetDocumentation(text)
        self.usd.SetDefaultPrim(self.world)
        self.geom.Scope.Define(self.usd, "/World/Looks")
        self._looks: dict[Colour, Any] = {}

    def write(self, path: Path) -> None:
        """Write a file as its name ends, whole or not at all; one that is there is replaced.

        Raises:
            FieldError: The file cannot be written.
        """
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=".usd-") as folder:
            try:
                self._exported(Path(folder), path.suffix).replace(path)
            except self._tf.ErrorException as error:
                raise FieldError(
                    "usd",
                    path,
                    "the library of USD could not write it; see whether the disk is full, or name another folder.",
                ) from error

    def _exported(self, folder: Path, suffix: str) -> Path:
        whole = (folder / "run").with_suffix(".usdc" if suffix == ".usdz" else suffix)
        self.usd.GetRootLayer().Export(str(whole))
        if suffix == ".usdz":
            utilities = optional_module("pxr.UsdUtils", "usd", "`usd`")
            utilities.CreateNewUsdzPackage(str(whole), str(whole.with_suffix(".usdz")))
        return whole.with_suffix(suffix)

    def name(self, text: str) -> str:
        """A text as the name of a prim."""
        return self._tf.MakeValidIdentifier(text)

    def group(self, path: str) -> Any:
        """A prim that others are put below and move with."""
        return self.geom.Xform.Define(self.usd, path)

    def mesh(
        self, path: str, vertices_m: NDArray[np.float64], faces: NDArray[np.int64], colour: Colour
    ) -> Any:
        """A surface of one colour, smooth where it bends gently and sharp at its edges."""
        mesh = self.geom.Mesh.Define(self.usd, path)
        mesh.CreateSubdivisionSchemeAttr(self.geom.Tokens.none)
        mesh.CreateDoubleSidedAttr(True)
        mesh.CreateDisplayColorAttr([colour[:3]])
        mesh.CreateDisplayOpacityAttr([colour[3]])
        mesh.SetNormalsInterpolation(self.geom.Tokens.vertex)
        self.set_surface(mesh, vertices_m, faces)
        self._bind(mesh, colour)
        return mesh

    def set_surface(
        self, mesh: Any, vertices_m: NDArray[np.float64], faces: NDArray[np.int64], *time: float
    ) -> None:
        """Give a mesh its surface at a time code, or for good."""
        points_m, normals, corners = creased(vertices_m, faces)
        points = self._points(points_m)
        indices = np.ascontiguousarray(corners.ravel(), dtype=np.int32)
        mesh.CreatePointsAttr().Set(points, *time)
        mesh.CreateNormalsAttr().Set(self._points(normals), *time)
        mesh.CreateFaceVertexCountsAttr().Set(self._vt.IntArray([3] * len(corners)), *time)
        mesh.CreateFaceVertexIndicesAttr().Set(self._vt.IntArray.FromNumpy(indices), *time)
        self._set_extent(mesh, points, *time)

    def marks(self, path: str, places_m: NDArray[np.float64], width_m: float, colour: Colour) -> Any:
        """Dots."""
        marks = self.geom.Points.Define(self.usd, path)
        points = self._points(places_m)
        marks.CreatePointsAttr(points)
        marks.CreateWidthsAttr([width_m] * len(places_m))
        marks.CreateDisplayColorAttr([colour[:3]])
        self._set_extent(marks, points)
        self._bind(marks, colour)
        return marks

    def lines(
        self,
        path: str,
        pieces_m: NDArray[np.float64],
        width_m: float,
        colours: list[tuple[float, float, float]],
    ) -> Any:
        """Straight pieces, shape (P, 2, 3) [m], each of its own colour."""
        curves = self.geom.BasisCurves.Define(self.usd, path)
        points = self._points(pieces_m.reshape(-1, 3))
        curves.CreateTypeAttr(self.geom.Tokens.linear)
        curves.CreatePointsAttr(points)
        curves.CreateCurveVertexCountsAttr([2] * len(pieces_m))
        curves.CreateWidthsAttr([width_m])
        curves.SetWidthsInterpolation(self.geom.Tokens.constant)
        curves.CreateDisplayColorAttr(colours)
        curves.GetDisplayColorPrimvar().SetInterpolation(self.geom.Tokens.uniform)
        self._set_extent(curves, points)
        return curves

    def move(
        self, prim: Any, times: NDArray[np.float64], places_m: NDArray[np.float64], turns: Rotation
    ) -> None:
        """Give a prim its place at some time codes, between which it goes straight."""
        way = np.hstack([places_m, turns.as_quat(scalar_first=True)])
        is_kept = np.ones(len(way), dtype=bool)
        # While it stands still, its first and its last moment tell all.
        is_kept[1:-1] = (way[1:-1] != way[:-2]).any(axis=1) | (way[1:-1] != way[2:]).any(axis=1)
        translate, orient = prim.AddTranslateOp(), prim.AddOrientOp()
        for time, row in zip(times[is_kept].tolist(), way[is_kept].tolist(), strict=True):
            translate.Set(self._gf.Vec3d(*row[:3]), time)
            orient.Set(self._gf.Quatf(*row[3:]), time)

    def show(self, prim: Any, is_shown: bool, time: float) -> None:
        """Show a prim from a time code on, or hide it."""
        tokens = self.geom.Tokens
        prim.CreateVisibilityAttr().Set(tokens.inherited if is_shown else tokens.invisible, time)

    def camera_and_light(self, view: Viewpoint) -> None:
        """A camera at a viewpoint, light from everywhere and light from above."""
        camera = self.geom.Camera.Define(self.usd, "/World/Camera")
        right, up, forward = view.R_world_camera.T
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = np.column_stack([right, up, -forward]), view.eye_m
        # The library multiplies rows by matrices.
        camera.AddTransformOp().Set(self._gf.Matrix4d(T.T.tolist()))
        camera.CreateFocalLengthAttr(FOCAL_LENGTH)
        camera.CreateVerticalApertureAttr(2.0 * view.half_height * FOCAL_LENGTH)
        camera.CreateHorizontalApertureAttr(2.0 * view.half_height * view.aspect * FOCAL_LENGTH)
        camera.CreateHorizontalApertureOffsetAttr(view.centre[0] * FOCAL_LENGTH)
        camera.CreateVerticalApertureOffsetAttr(view.centre[1] * FOCAL_LENGTH)
        camera.CreateClippingRangeAttr(self._gf.Vec2f(NEAR_M, FAR_M))
        self._lux.DomeLight.Define(self.usd, "/World/Sky").CreateIntensityAttr(SKY)
        for name, (intensity, turn_deg) in SUNS.items():
            sun = self._lux.DistantLight.Define(self.usd, f"/World/{name}")
            sun.CreateNormalizeAttr(True)
            sun.CreateIntensityAttr(intensity)
            sun.AddRotateXYZOp().Set(self._gf.Vec3f(*turn_deg))

    def _points(self, points_m: NDArray[np.float64]) -> Any:
        """Points or normals as the library has them."""
        return self._vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points_m, dtype=np.float32))

    def _set_extent(self, prim: Any, points: Any, *time: float) -> None:
        extent = self.geom.PointBased.ComputeExtent(points) if len(points) else [self._gf.Vec3f()] * 2
        prim.CreateExtentAttr().Set(extent, *time)

    def _bind(self, prim: Any, colour: Colour) -> None:
        self._shade.MaterialBindingAPI.Apply(prim.GetPrim()).Bind(self._look(colour))

    def _look(self, colour: Colour) -> Any:
        """The material of a colour and its opacity, which is made once."""
        if colour not in self._looks:
            path = f"/World/Looks/look_{len(self._looks) + 1}"
            look, shader = (
                self._shade.Material.Define(self.usd, path),
                self._shade.Shader.Define(self.usd, f"{path}/surface"),
            )
            shader.CreateIdAttr("UsdPreviewSurface")
            shader.CreateInput("diffuseColor", self.kinds.Color3f).Set(self._gf.Vec3f(*colour[:3]))
            shader.CreateInput("opacity", self.kinds.Float).Set(colour[3])
            shader.CreateInput("roughness", self.kinds.Float).Set(0.5)
            look.CreateSurfaceOutput().ConnectToSource(shader.CreateOutput("surface", self.kinds.Token))
            self._looks[colour] = look
        return self._looks[colour]
