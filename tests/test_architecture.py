"""The house: one way of imports through its rooms, no circle anywhere, and a science that never sees the simulator."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("mapping", "planner", "sim")
ROOMS = (
    "mapping",
    "planner",
    "sim",
    "sim.plugs",
    "sim.world",
    "sim.world.solids",
    "sim.world.meshes",
    "sim.world.volumes",
    "sim.world.anatomy",
    "sim.world.arms",
    "sim.world.scene",
    "sim.world.ik",
    "sim.world.motion",
    "sim.world.sensing",
    "sim.episode",
    "sim.record",
    "sim.findings",
    "sim.pictures",
    "sim.report",
    "sim.viewing",
    "sim.reach",
    "sim.running",
    "sim.campaign",
    "sim.comparison",
    "sim.doctor",
    "sim.cli",
)
"""Every room, the lowest first: a room imports from itself and from those before it."""
WITHIN = {
    "mapping.belief": "mapping",
    "planner.find_and_outline": "planner",
    "sim.campaign.engines": "sim.campaign",
}
"""Rooms within a room, which stand on some of its modules and serve others."""
MOST_FILES, MOST_LINES = 15, 300
SIMULATOR = {"mujoco", "mink", "trimesh", "matplotlib", "PIL", "tyro", "tqdm"}
"""What the science never imports: it is read and tested without a simulator."""
SCIENCE = {"numpy", "scipy", "threadpoolctl"}  # the last sets the threads of the other two's BLAS


def modules(package):
    return sorted((ROOT / package).rglob("*.py"))


def imported(path):
    """Absolute dotted names of everything that a module imports, wherever in the file the import stands."""
    package = path.relative_to(ROOT).parent.parts
    names = set()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            base = package[: len(package) - node.level + 1] if node.level else ()
            module = ".".join((*base, *(node.module or "").split("."))).rstrip(".")
            # `from . import x` names a module by its alias; `from .x import name` names a module itself.
            names |= {f"{module}.{alias.name}" for alias in node.names} | {module}
    return names


def tops(path):
    return {name.split(".")[0] for name in imported(path)}


def relative(path):
    return str(path.relative_to(ROOT))


def dotted(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def room_of(module):
    """The room that a module, or a package itself, stands in."""
    package = module if (ROOT / module.replace(".", "/")).is_dir() else module.rpartition(".")[0]
    return WITHIN.get(package, package)


def import_graph():
    """The modules of ours that each module imports, wherever in its file the import stands."""
    known = {dotted(path) for path in ALL_MODULES}
    return {
        dotted(path): {name for name in imported(path) if name in known and name != dotted(path)}
        for path in ALL_MODULES
    }


def arrows_back(graph, rooms=ROOMS):
    """Imports from a room that stands before the one they point to."""
    place = {room: index for index, room in enumerate(rooms)}
    return [
        f"{module} -> {other}"
        for module, others in sorted(graph.items())
        for other in sorted(others)
        if place[room_of(module)] < place[room_of(other)]
    ]


def circle(graph):
    """The modules of a circle of imports, in order; an empty list where there is none."""
    done, path = set(), []

    def visit(module):
        if module in path:
            return [*path[path.index(module) :], module]
        if module in done:
            return []
        path.append(module)
        for other in sorted(graph.get(module, ())):
            if found := visit(other):
                return found
        done.add(path.pop())
        return []

    return next((found for module in sorted(graph) if (found := visit(module))), [])


SCIENCE_MODULES = [*modules("mapping"), *modules("planner")]
ALL_MODULES = [path for package in PACKAGES for path in modules(package)]
GRAPH = import_graph()


def test_the_packages_have_modules():
    assert all(len(modules(package)) > 3 for package in PACKAGES)


def test_relative_imports_are_resolved_from_the_module_that_makes_them():
    # What all other tests here stand on: one known import of each kind.
    assert "planner.cone.Cone" in imported(ROOT / "planner" / "situation.py")
    assert "mapping" in tops(ROOT / "planner" / "situation.py")
    assert "sim.doctor.gl_probe" in imported(ROOT / "sim" / "doctor" / "diagnosis.py")
    assert "sim.world.scene.scene" in GRAPH["sim.world.ik.chain"]


def test_every_module_stands_in_a_room():
    assert {room_of(dotted(path)) for path in ALL_MODULES} == set(ROOMS)


def test_imports_point_one_way_through_the_rooms():
    assert arrows_back(GRAPH) == []


def test_there_is_no_circle_of_imports():
    assert circle(GRAPH) == []


def test_an_arrow_that_is_turned_back_is_found():
    turned = GRAPH | {"sim.world.ik.chain": GRAPH["sim.world.ik.chain"] | {"sim.episode.episode"}}
    assert arrows_back(turned) == ["sim.world.ik.chain -> sim.episode.episode"]
    assert {"sim.world.ik.chain", "sim.episode.episode"} <= set(circle(turned))


@pytest.mark.parametrize("folder", sorted({path.parent for path in ALL_MODULES}), ids=relative)
def test_a_room_is_no_shelf(folder):
    assert len(list(folder.glob("*.py"))) <= MOST_FILES
    assert ast.get_docstring(ast.parse((folder / "__init__.py").read_text()))


@pytest.mark.parametrize("path", ALL_MODULES, ids=relative)
def test_a_file_is_short_enough_to_be_read(path):
    assert len(path.read_text().splitlines()) <= MOST_LINES


@pytest.mark.parametrize("path", [path for path in modules("sim") if "cli" not in path.parts], ids=relative)
def test_only_the_command_line_knows_the_command_line(path):
    assert "tyro" not in tops(path)
    assert "sim.cli" not in {".".join(name.split(".")[:2]) for name in imported(path)}


@pytest.mark.parametrize("path", SCIENCE_MODULES, ids=relative)
def test_the_science_never_imports_the_simulator(path):
    assert not tops(path) & SIMULATOR
    assert "sim" not in tops(path)


@pytest.mark.parametrize("path", SCIENCE_MODULES, ids=relative)
def test_the_science_needs_numpy_and_scipy_with_their_threads_alone(path):
    others = tops(path) - set(sys.stdlib_module_names) - SCIENCE - {"mapping", "planner"}
    assert not others


@pytest.mark.parametrize("path", modules("mapping"), ids=relative)
def test_the_map_knows_no_planner(path):
    assert "planner" not in tops(path)


@pytest.mark.parametrize("path", modules("sim/world"), ids=relative)
def test_the_world_knows_no_map(path):
    assert "mapping" not in tops(path)  # only an episode brings the world and the map together


@pytest.mark.parametrize("path", ALL_MODULES, ids=relative)
def test_no_module_is_named_like_one_of_the_standard_library_or_like_a_drawer(path):
    assert path.stem not in sys.stdlib_module_names
    assert path.stem not in {"utils", "common", "helpers", "misc"}


@pytest.mark.parametrize("path", ALL_MODULES, ids=relative)
def test_randomness_comes_from_a_generator_that_is_passed(path):
    allowed = {"Generator", "default_rng", "SeedSequence", "BitGenerator", "PCG64"}
    used = {
        node.attr
        for node in ast.walk(ast.parse(path.read_text()))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Attribute)
        and node.value.attr == "random"
        and isinstance(node.value.value, ast.Name)
        and node.value.value.id in {"np", "numpy"}
    }
    assert used <= allowed


@pytest.mark.parametrize("package", sorted({path.parent for path in ALL_MODULES}), ids=relative)
def test_an_init_file_re_exports_and_does_nothing_else(package):
    body = ast.parse((package / "__init__.py").read_text()).body
    is_all = [isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__" for node in body]
    kinds = (ast.ImportFrom, ast.Import, ast.Expr)
    assert all(isinstance(node, kinds) or is_list for node, is_list in zip(body, is_all, strict=True))


def test_a_worker_of_trials_starts_without_what_it_seldom_needs():
    """Each of these takes a third of a second or more, in every process that a campaign starts."""
    seldom = {"scipy.stats", "toppra", "matplotlib.pyplot", "sim.pictures.figures"}
    code = f"import sys, sim.campaign.trial; print(*{seldom} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
