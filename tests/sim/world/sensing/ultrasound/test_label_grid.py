"""The grid of tissues: as the solids say, smooth to a fraction of its spacing, and what lies over what."""

import dataclasses

import numpy as np
import pytest
import trimesh

from sim.world.anatomy.structures import Structure
from sim.world.sensing.errors.echogenicity import echogenicity_of
from sim.world.sensing.ultrasound.label_grid import LabelGrid, cut_grid
from sim.world.sensing.ultrasound.tissues import BY_LESION, TISSUES, lesion_bodies, tissue_of_structure
from sim.world.sensing.ultrasound.tracing import incidence_cosine, label_at
from sim.world.solids.solid import Solid

ROLES = {
    "surroundings": TISSUES["fat"],
    "organ": TISSUES["liver"],
    "target": TISSUES["fluid"],
}


def cut(anatomy, structures=()) -> LabelGrid:
    lesions = lesion_bodies(anatomy.tumours, "hypoechoic")
    return cut_grid(anatomy, lesions=lesions, structures=structures, **ROLES)


def names_at(grid: LabelGrid, points_m) -> list[str]:
    places = (np.asarray(points_m) - grid.origin_m) / grid.spacing_m
    return [grid.tissues[label_at(grid.cells, grid.labels, grid.margins, *place)].name for place in places]


@pytest.fixture(scope="module")
def grid(ball_anatomy):
    return cut(ball_anatomy)


def test_labels_are_those_of_the_solids_but_for_a_fraction_of_the_spacing(grid, ball_anatomy):
    rng = np.random.default_rng(0)
    points_m = np.array([0.5, 0.0, 0.06]) + rng.uniform(-0.065, 0.065, (20_000, 3))
    truth = np.where(ball_anatomy.is_inside_organ(points_m), "liver", "fat").astype(object)
    truth[ball_anatomy.is_tumour(points_m)] = "hypoechoic"
    is_wrong = np.array(names_at(grid, points_m)) != truth
    # All that is wrong lies within a third of the spacing of some surface: the balls' centres and radii are known.
    balls = [((0, 0, 0), 0.06), ((0, 0, 0.02), 0.015), ((0.012, 0, 0.015), 0.012)]
    gaps_m = [
        np.abs(np.linalg.norm(points_m - [0.5 + c[0], c[1], 0.06 + c[2]], axis=1) - radius_m)
        for c, radius_m in balls
    ]
    # The icosphere itself lies up to 0.2 mm within its ball.
    assert np.min(gaps_m, axis=0)[is_wrong].max() < 0.55e-3
    assert is_wrong.mean() < 0.005


def test_beyond_the_grid_lie_the_surroundings(grid):
    assert names_at(grid, [[0.0, 0.0, 0.0], [0.5, 0.0, 5.0], [-3.0, 0.0, 0.1]]) == ["fat"] * 3


def test_a_ball_on_a_coarse_grid_is_round():
    n, spacing_m, radius_m = 24, 1.0, 7.3
    axes = np.arange(n) - 11.4
    depth_m = radius_m - np.sqrt((np.stack(np.meshgrid(axes, axes, axes, indexing="ij")) ** 2).sum(axis=0))
    margins = np.clip(np.abs(depth_m), 1e-3, 0.5).astype(np.float32)
    labels = (depth_m > 0.0).astype(np.uint8)
    tissues = [TISSUES["fat"], TISSUES["liver"]]
    grid = LabelGrid.from_labels(tissues, labels, margins, origin_m=np.full(3, -11.4), spacing_m=spacing_m)
    rng = np.random.default_rng(0)
    for direction in rng.normal(size=(200, 3)):
        unit = direction / np.linalg.norm(direction)
        radii = np.arange(5.0, 9.0, 0.02)
        is_in = np.array(names_at(grid, radii[:, None] * unit)) == "liver"
        # A seventh of the spacing, where nearest nodes err by half of it and more.
        assert radii[is_in].max() == pytest.approx(radius_m, abs=0.15)
        place = (radius_m * unit + 11.4) / spacing_m
        assert incidence_cosine(grid.labels, grid.margins, *place, unit, 1) > 0.985


def bar(name: str) -> Structure:
    mesh = trimesh.creation.box((0.004, 0.09, 0.004))
    mesh.apply_translation((0.5, 0.0, 0.08))
    return Structure(name=name, solid=Solid.from_trimesh(mesh))


def test_a_vessel_lies_over_a_tumour_and_a_structure_without_a_tissue_below_it(ball_anatomy):
    through = [[0.5, 0.0, 0.08]], [[0.5, 0.03, 0.08]]
    for name, in_tumour, in_organ in (
        ("hepatic vein", "blood", "blood"),
        ("thing", "hypoechoic", "soft-tissue"),
    ):
        structure = bar(name)
        anatomy = dataclasses.replace(ball_anatomy, structures=(structure,))
        grid = cut(anatomy, [tissue_of_structure(name)])
        assert names_at(grid, through[0]) == [in_tumour]
        assert names_at(grid, through[1]) == [in_organ]


def test_tumours_count_only_within_the_organ(ball_anatomy):
    mesh = trimesh.creation.icosphere(radius=0.01)
    mesh.apply_translation((0.5, 0.0, 0.12))
    grid = cut(dataclasses.replace(ball_anatomy, tumours=(Solid.from_trimesh(mesh),)))
    assert names_at(grid, [[0.5, 0.0, 0.115], [0.5, 0.0, 0.125]]) == ["hypoechoic", "fat"]


def lesions_that_look(ball, names) -> list[Solid]:
    """Balls, each of another size until it looks as wanted; the look is drawn by the vertices."""
    found = []
    for name in names:
        sizes = (Solid(ball.vertices_m * (1.0 + 1e-6 * n), ball.faces) for n in range(1000))
        found.append(next(solid for solid in sizes if echogenicity_of(solid).name == name))
    return found


def test_each_lesion_may_have_the_look_that_belongs_to_it(ball_anatomy):
    ball = ball_anatomy.tumours[0]
    hypo, hyper, iso = lesions_that_look(ball, ("hypoechoic", "hyperechoic", "isoechoic"))
    assert [tissue.name for _, tissue in lesion_bodies([hypo, hyper, iso], BY_LESION)] == [
        "hypoechoic",
        "hyperechoic",
        "isoechoic",
    ]
    assert [tissue.name for _, tissue in lesion_bodies([hypo, hyper], "fluid")] == ["fluid", "fluid"]


def test_a_lesion_of_both_kinds_has_a_bright_core_in_a_dark_rim(ball_anatomy):
    (mixed,) = lesions_that_look(ball_anatomy.tumours[0], ("mixed",))
    anatomy = dataclasses.replace(ball_anatomy, tumours=(mixed,))
    grid = cut_grid(anatomy, lesions=lesion_bodies([mixed], BY_LESION), structures=[], **ROLES)
    # The ball lies about 0.5, 0, 0.08 with a radius of 15 mm, its core of 9 mm.
    places_m = [[0.5, 0.0, 0.08], [0.507, 0.0, 0.08], [0.512, 0.0, 0.08], [0.52, 0.0, 0.08]]
    assert names_at(grid, places_m) == ["hyperechoic", "hyperechoic", "hypoechoic", "liver"]


def test_an_open_surface_is_a_shell_and_fills_nothing(ball_anatomy):
    mesh = trimesh.creation.cylinder(radius=0.008, height=0.05)
    mesh.apply_translation((0.5, 0.0, 0.03))
    caps = np.abs(mesh.face_normals[:, 2]) > 0.9
    tube = Structure(
        name="portal vein", solid=Solid(np.asarray(mesh.vertices), np.asarray(mesh.faces)[~caps])
    )
    grid = cut(dataclasses.replace(ball_anatomy, structures=(tube,)), [TISSUES["blood"]])
    assert names_at(grid, [[0.5, 0.0, 0.03], [0.5, 0.0, 0.10], [0.508, 0.0, 0.03]]) == [
        "liver",
        "liver",
        "blood",
    ]


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("hepatic_vein", "blood"),
        ("Pfortader", "blood"),
        ("aorta", "blood"),
        ("rib_4", "bone"),
        ("Rib4", "bone"),
        ("vertebra", "bone"),
        ("gallbladder", "fluid"),
        ("Gallenblase", "fluid"),
        ("cyst 2", "fluid"),
        ("lung", "gas"),
        ("calcification", "calcification"),
        ("falciform ligament", "hyperechoic"),
        ("thing", "soft-tissue"),
        ("Segment_3", "soft-tissue"),
    ],
)
def test_a_structures_name_tells_its_tissue_and_what_tells_none_is_soft_tissue(name, expected):
    assert tissue_of_structure(name).name == expected
    assert tissue_of_structure(name, {name: "gas"}).name == "gas"
