"""The layers: imports point one way, sim -> planner -> mapping, and the science never sees the simulator."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("mapping", "planner", "sim")
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


SCIENCE_MODULES = [*modules("mapping"), *modules("planner")]
ALL_MODULES = [path for package in PACKAGES for path in modules(package)]


def test_the_packages_have_modules():
    assert all(len(modules(package)) > 3 for package in PACKAGES)


def test_relative_imports_are_resolved_from_the_module_that_makes_them():
    # What all other tests here stand on: one known import of each kind.
    assert "planner.cone.Cone" in imported(ROOT / "planner" / "situation.py")
    assert "mapping" in tops(ROOT / "planner" / "situation.py")
    assert "sim.doctor.gl_probe" in imported(ROOT / "sim" / "doctor.py")


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
def test_the_world_imports_nothing_from_the_programs_above_it(path):
    above = {
        name
        for name in imported(path)
        if name.split(".")[0] == "sim" and not f"{name}.".startswith("sim.world.")
    }
    assert not above
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


@pytest.mark.parametrize("package", ["mapping", "planner", "sim", "sim/world"])
def test_an_init_file_re_exports_and_does_nothing_else(package):
    body = ast.parse((ROOT / package / "__init__.py").read_text()).body
    is_all = [isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "__all__" for node in body]
    kinds = (ast.ImportFrom, ast.Import, ast.Expr)
    assert all(isinstance(node, kinds) or is_list for node, is_list in zip(body, is_all, strict=True))


def test_a_worker_of_trials_starts_without_what_it_seldom_needs():
    """Each of these takes a third of a second or more, in every process that a campaign starts."""
    seldom = {"scipy.stats", "toppra", "matplotlib.pyplot", "sim.pictures.figures"}
    code = f"import sys, sim.campaign.trial; print(*{seldom} & set(sys.modules))"
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert run.stdout.split() == []
