"""The doctor: each fault is named with its remedy, and what is well is not called ill."""

import io

from sim.doctor.diagnosis import (
    Diagnosis,
    Finding,
    find_packages,
    find_python,
    find_renderers,
    print_diagnosis,
)
from sim.doctor.gl_probe import GlProbe, probe_gl


def probe(name, frame_s=None):
    return GlProbe(
        name=name, is_working=frame_s is not None, frame_s=frame_s, message="" if frame_s else "broken"
    )


def statuses(findings):
    return [finding.status for finding in findings]


def test_an_old_python_is_red_and_a_new_one_is_not():
    assert find_python((3, 10, 9)).status == "red"
    assert "3.11" in find_python((3, 10, 9)).remedy
    assert find_python((3, 11, 0)).status == "ok"
    assert find_python((4, 0, 0)).status == "ok"


def test_packages_are_red_when_missing_or_of_another_version():
    findings = find_packages(
        ["numpy>=2.0", "mujoco<1", "no-such-package-here>=1", 'pytest>=999; extra == "dev"']
    )
    assert statuses(findings) == ["ok", "red", "red"]
    assert "remove .venv" in findings[1].remedy
    assert "pip install 'no-such-package-here>=1'" in findings[2].remedy


def test_a_project_that_is_not_installed_is_red():
    (finding,) = find_packages(None)
    assert finding.status == "red"
    assert "pip install -e " in finding.remedy


def test_one_renderer_without_a_display_is_enough():
    findings = find_renderers([probe("egl"), probe("osmesa", 0.02), probe("glfw")], chosen=None)
    assert statuses(findings) == ["note", "ok", "note"]
    assert "20 ms" in findings[1].found


def test_no_renderer_without_a_display_is_red_and_names_the_packages():
    findings = find_renderers([probe("egl"), probe("osmesa"), probe("glfw", 0.01)], chosen=None)
    assert statuses(findings) == ["red", "red", "ok"]
    assert "libegl1 libgl1" in findings[0].remedy
    assert "libosmesa6" in findings[0].remedy


def test_a_mujoco_gl_that_does_not_work_is_red():
    probes = [probe("egl", 0.01), probe("osmesa"), probe("glfw")]
    assert statuses(find_renderers(probes, chosen="egl")) == ["ok", "note", "note"]
    findings = find_renderers(probes, chosen="osmesa")
    assert findings[-1].subject == "MUJOCO_GL"
    assert findings[-1].status == "red"


def test_here_a_renderer_works_and_a_name_that_mujoco_does_not_know_fails_with_a_message():
    assert any(probe_gl(name).is_working for name in ("egl", "osmesa"))
    unknown = probe_gl("nonsense")
    assert not unknown.is_working
    assert "nonsense" in unknown.message


def test_the_table_shows_each_remedy_and_the_exit_code_tells_red():
    well = Finding(subject="python", status="ok", found="3.12")
    ill = Finding(subject="mink", status="red", found="not installed", remedy="pip install mink")
    assert Diagnosis(findings=(well,)).exit_code == 0
    diagnosis = Diagnosis(findings=(well, ill))
    assert diagnosis.exit_code == 1
    stream = io.StringIO()
    print_diagnosis(diagnosis, stream)
    lines = stream.getvalue().splitlines()
    assert lines[0].split() == ["python", "ok", "3.12"]
    assert lines[2].split() == ["->", "pip", "install", "mink"]
    assert lines[-1].startswith("1 red")
