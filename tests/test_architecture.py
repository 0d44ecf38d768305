"""The house: one way of imports through its rooms, no circle anywhere, and a science that never sees the simulator."""

import ast
import subprocess
import sys
from functools import cache
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("mapping", "planner", "sim")
ROOMS = (
    "mapping",
    "planner",
    "sim",
    "sim.plugs",
    "sim.world",
    "sim.world.solids",
    "sim.world.tissue",
    "sim.world.meshes",
    "sim.world.volumes",
    "sim.world.anatomy",
    "sim.world.arms",
    "sim.world.probes",
    "sim.world.scene",
    "sim.world.camera",
    "sim.world.ik",
    "sim.world.motion",
    "sim.world.sensing",
    "sim.world.body",
    "sim.episode",
    "sim.record",
    "sim.live",
    "sim.findings",
    "sim.pictures",
    "sim.report",
    "sim.viewing",
    "sim.reach",
    "sim.running",
    "sim.gym",
    "sim.campaign",
    "sim.dataset",
    "sim.bound",
    "sim.comparison",
    "sim.bench",
    "sim.doctor",
    "sim.cli",
)
"""Every room, the lowest first: a room imports from itself and from those before it."""
WITHIN = {
    "mapping.belief": "mapping",
    "mapping.near_tumour": "mapping",
    "mapping.registration": "mapping",
    "mapping.trust": "mapping",
    "sim.world.sensing.errors": "sim.world.sensing",
    "planner.baselines": "planner",
    "planner.find_and_outline": "planner",
    "planner.paths": "planner",
    "planner.stopping": "planner",
    "planner.trained": "planner",
    "sim.campaign.engines": "sim.campaign",
    "sim.comparison.lesions": "sim.comparison",
    "sim.bound.check": "sim.bound",
    "sim.cli.studies": "sim.cli",
    "sim.cli.sensing": "sim.cli",
    "sim.cli.live": "sim.cli",
    "sim.world.volumes.dicom": "sim.world.volumes",
    "sim.world.anatomy.given": "sim.world.anatomy",
    "sim.episode.planned": "sim.episode",
    "sim.episode.moving": "sim.episode",
    "sim.live.igtl": "sim.live",
    "sim.live.arm": "sim.live",
    "sim.live.ros": "sim.live",
    "sim.viewing.usd": "sim.viewing",
    "sim.episode.sweeping": "sim.episode",
    "sim.running.placing": "sim.running",
    "sim.running.live": "sim.running",
    "sim.world.sensing.ultrasound": "sim.world.sensing",
    "sim.world.sensing.image_reader": "sim.world.sensing",
}
"""Rooms within a room, which stand on some of its modules and serve others."""
MOST_FILES, MOST_LINES = 15, 300
SIMULATOR = {"mujoco", "mink", "trimesh", "matplotlib", "PIL", "tyro", "tqdm"}
"""What the science never imports: it is read and tested without a simulator."""
SCIENCE = {"numpy", "scipy", "threadpoolctl"}  # the last sets the threads of the other two's BLAS


def modules(package):
    return sorted((ROOT / package).rglob("*.py"))


@cache
def text(path):
    return path.read_text()


@cache
def tree(path):
    return ast.parse(text(path))


@cache
def imported(path):
    """Absolute dotted names of everything that a module imports, wherever in the file the import stands."""
    package = path.relative_to(ROOT).parent.parts
    names = set()
    for node in ast.walk(tree(path)):
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


def names(paths):
    """Offenders as a failed test shows them."""
    return sorted(str(path.relative_to(ROOT)) for path in paths)


def is_of(package, module):
    return module == package or module.startswith(f"{package}.")


def dotted(path):
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def room_of(module):
    """The room that a module, or a package itself, stands in."""
    package = module if (ROOT / module.replace(".", "/")).is_dir() else module.rpartition(".")[0]
    return WITHIN.get(package, package)


@cache
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


def test_the_packages_have_modules():
    assert all(len(modules(package)) > 3 for package in PACKAGES)


def test_relative_imports_are_resolved_from_the_module_that_makes_them():
    # What all other tests here stand on: one known import of each kind.
    assert "planner.cone.Cone" in imported(ROOT / "planner" / "situation.py")
    assert "mapping" in tops(ROOT / "planner" / "situation.py")
    assert "sim.doctor.gl_probe" in imported(ROOT / "sim" / "doctor" / "diagnosis.py")
    assert "sim.world.scene.scene" in import_graph()["sim.world.ik.chain"]


def test_every_module_stands_in_a_room():
    assert {room_of(dotted(path)) for path in ALL_MODULES} == set(ROOMS)


def test_imports_point_one_way_through_the_rooms():
    assert arrows_back(import_graph()) == []


def test_there_is_no_circle_of_imports():
    assert circle(import_graph()) == []


def test_an_arrow_that_is_turned_back_is_found():
    graph = import_graph()
    turned = graph | {"sim.world.ik.chain": graph["sim.world.ik.chain"] | {"sim.episode.episode"}}
    assert arrows_back(turned) == ["sim.world.ik.chain -> sim.episode.episode"]
    assert {"sim.world.ik.chain", "sim.episode.episode"} <= set(circle(turned))


def test_a_room_is_no_shelf():
    """Few files, and a paragraph in the package's docstring that says what lives there."""
    folders = {path.parent for path in ALL_MODULES}
    crowded = [folder for folder in folders if len(list(folder.glob("*.py"))) > MOST_FILES]
    assert names(crowded) == []
    assert names(folder for folder in folders if not ast.get_docstring(tree(folder / "__init__.py"))) == []


def test_a_file_is_short_enough_to_be_read():
    assert names(path for path in ALL_MODULES if len(text(path).splitlines()) > MOST_LINES) == []


def test_only_the_command_line_knows_the_command_line():
    below = [path for path in modules("sim") if "cli" not in path.parts]
    assert names(path for path in below if "tyro" in tops(path)) == []
    assert names(path for path in below if any(is_of("sim.cli", name) for name in imported(path))) == []


def test_the_science_never_imports_the_simulator():
    assert names(path for path in SCIENCE_MODULES if tops(path) & (SIMULATOR | {"sim"})) == []


def test_the_science_needs_numpy_and_scipy_with_their_threads_alone():
    known = set(sys.stdlib_module_names) | SCIENCE | {"mapping", "planner"}
    assert names(path for path in SCIENCE_MODULES if tops(path) - known) == []


def test_the_map_knows_no_planner():
    assert names(path for path in modules("mapping") if "planner" in tops(path)) == []


def test_the_world_knows_no_map():
    # Only an episode brings the world and the map together.
    assert names(path for path in modules("sim/world") if "mapping" in tops(path)) == []


def test_no_module_is_named_like_one_of_the_standard_library_or_like_a_drawer():
    avoided = set(sys.stdlib_module_names) | {"utils", "common", "helpers", "misc"}
    assert names(path for path in ALL_MODULES if path.stem in avoided) == []


def test_randomness_comes_from_a_generator_that_is_passed():
    allowed = {"Generator", "default_rng", "SeedSequence", "BitGenerator", "PCG64"}
    assert names(path for path in ALL_MODULES if numpy_random(path) - allowed) == []


def numpy_random(path):
    """What a module uses of `numpy.random`."""
    return {
        node.attr
        for node in ast.walk(tree(path))
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Attribute)
        and node.value.attr == "random"
        and isinstance(node.value.value, ast.Name)
        and node.value.value.id in {"np", "numpy"}
    }


def test_an_init_file_re_exports_and_does_nothing_else():
    files = [path for path in ALL_MODULES if path.name == "__init__.py"]
    assert names(path for path in files if not all(map(is_re_export, tree(path).body))) == []


def is_re_export(node):
    is_all = isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__"
    return is_all or isinstance(node, (ast.ImportFrom, ast.Import, ast.Expr))


def test_a_worker_of_trials_starts_without_what_it_seldom_needs():
    """Each of these takes a tenth of a second or more, in every process that a campaign starts."""
    seldom = {"scipy.stats", "toppra", "matplotlib.pyplot", "sim.pictures.figures", "nibabel"}
    code = f"import sys, sim.campaign.trial; print(*{seldom} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
