"""The physics of the image: speckle, attenuation, resolution, boundaries, enhancement, shadow, contact."""

import dataclasses

import numpy as np
import pytest
from phantoms import ball_phantom, tissue, uniform_phantom

from sim.world.sensing.ultrasound import beam
from sim.world.sensing.ultrasound.convex_array import ConvexArray
from sim.world.sensing.ultrasound.imager import SPECKLE_DB, Imager
from sim.world.sensing.ultrasound.label_grid import LabelGrid
from sim.world.sensing.ultrasound.settings import Settings
from sim.world.sensing.ultrasound.tissues import TISSUES

ARRAY = ConvexArray()
QUIET = Settings(noise_db=-300.0)
LINES = slice(12, -12)
"""Lines far enough from the edges that the beam loses nothing over them."""


def envelopes(grid, n_planes, array=ARRAY, settings=QUIET):
    """Envelopes of planes far apart, shape (n_planes, S, L)."""
    imager, found = Imager(array, settings), []
    for index in range(n_planes):
        T = np.eye(4)
        T[1, 3] = 0.1 * index
        found.append(imager.plane(grid, T).envelope)
    return np.array(found)


@pytest.fixture(scope="module")
def plain_speckle():
    return envelopes(uniform_phantom(tissue()), 6)[:, :, LINES]


@pytest.mark.parametrize("depths_mm", [(8, 30), (50, 75), (100, 125)])
def test_fully_developed_speckle_has_the_envelope_of_a_rayleigh_distribution(plain_speckle, depths_mm):
    first, last = (int(depth * 1e-3 / ARRAY.sample_m) for depth in depths_mm)
    envelope = plain_speckle[:, first:last]
    # sqrt(pi / (4 - pi)) = 1.91. Some 5,000 cells of resolution give 1 %; the requirement is 5 %.
    assert envelope.mean() / envelope.std() == pytest.approx(np.sqrt(np.pi / (4.0 - np.pi)), rel=0.05)
    # Of a Rayleigh distribution a share of exp(-x^2) lies above x times the root mean square.
    rms = np.sqrt((envelope**2).mean())
    for level in (0.5, 1.0, 1.5):
        assert (envelope > level * rms).mean() == pytest.approx(np.exp(-(level**2)), abs=0.03)


def test_speckle_without_attenuation_is_equally_bright_at_every_depth(plain_speckle):
    power = (plain_speckle[:, 40:-40] ** 2).mean(axis=(0, 2)).reshape(16, -1).mean(axis=1)
    # A band holds some 2,000 cells of resolution: 0.1 dB of chance, and as much of the analytic level.
    np.testing.assert_allclose(10.0 * np.log10(power), 0.0, atol=0.6)


@pytest.mark.parametrize("attenuation", [0.3, 0.7])
def test_echoes_fall_by_the_attenuation_that_was_set(attenuation):
    envelope = envelopes(uniform_phantom(tissue(attenuation=attenuation)), 8)[:, 40:-40, LINES]
    power_db = 10.0 * np.log10((envelope**2).mean(axis=(0, 2)))
    slope_db_m = np.polyfit(ARRAY.depths_m[40:-40], power_db, 1)[0]
    assert slope_db_m == pytest.approx(-2.0 * attenuation * 100.0 * 3.5, rel=0.05)


def test_compensation_for_the_tissues_attenuation_makes_the_picture_even():
    settings = dataclasses.replace(QUIET, tgc_db_cm_mhz=0.6)
    imager = Imager(ARRAY, settings)
    image = imager.plane(uniform_phantom(tissue(attenuation=0.6)), np.eye(4)).image.astype(float)
    rows = [image[row : row + 40, 200:312].mean() for row in range(100, 420, 40)]
    # Brightness is 255 levels over 60 dB: 5 levels are 1.2 dB.
    assert np.ptp(rows) < 5.0


def width_at_half(profile, spacing):
    """Full width of a peak at half of its height, by interpolation."""
    peak = int(np.argmax(profile))
    half = profile[peak] / 2.0
    right = peak + int(np.argmax(profile[peak:] < half))
    left = peak - int(np.argmax(profile[peak::-1] < half))
    beyond_right = (half - profile[right]) / (profile[right - 1] - profile[right])
    beyond_left = (half - profile[left]) / (profile[left + 1] - profile[left])
    return (right - beyond_right - left - beyond_left) * spacing


def point_widths(depth_m):
    """Widths of a point's image along and across the lines [m]."""
    signal = np.zeros((ARRAY.n_samples, ARRAY.n_lines, 2), np.float32)
    sample, line = int(depth_m / ARRAY.sample_m), ARRAY.n_lines // 2
    signal[sample, line, 0] = 1.0
    received = Imager(ARRAY, QUIET).receive(signal, 0)
    envelope = np.hypot(received[..., 0], received[..., 1])
    pitch_m = (ARRAY.radius_m + depth_m) * ARRAY.line_rad
    return width_at_half(envelope[:, line], ARRAY.sample_m), width_at_half(envelope[sample], pitch_m)


@pytest.mark.parametrize("depth_mm", [20, 40, 65, 90, 120])
def test_a_point_is_as_wide_as_the_beam_and_as_long_as_the_pulse(depth_mm):
    along_m, across_m = point_widths(depth_mm * 1e-3)
    # 5 %: the pulse has 2.5 samples, and straight lines between samples make a Gaussian a little wide.
    assert along_m == pytest.approx(beam.pulse_fwhm_m(ARRAY), rel=0.05)
    expected_m = beam.lateral_fwhm_m(ARRAY, np.array([depth_mm * 1e-3]))[0]
    assert across_m == pytest.approx(expected_m, rel=0.05)


def test_resolution_across_the_lines_worsens_with_depth_beyond_the_focus():
    widths_m = [point_widths(depth_m)[1] for depth_m in (0.065, 0.085, 0.105, 0.125)]
    assert np.all(np.diff(widths_m) > 0.0)
    # Diffraction at the focus, both ways: 1.206 lambda z / D / sqrt 2.
    assert widths_m[0] == pytest.approx(1.206 * 0.44e-3 * 65 / 16 / np.sqrt(2.0), rel=0.05)


def turned_about_the_centre(n_lines):
    """The pose of a plane turned in itself about the centre of the face's arc by whole lines."""
    angle = n_lines * ARRAY.line_rad
    T = np.eye(4)
    T[:3, :3] = [[np.cos(angle), 0, np.sin(angle)], [0, 1, 0], [-np.sin(angle), 0, np.cos(angle)]]
    T[:3, 3] = T[:3, :3] @ [0, 0, ARRAY.radius_m] - [0, 0, ARRAY.radius_m]
    return T


def test_the_same_place_has_the_same_speckle_from_two_poses():
    grid, imager = uniform_phantom(tissue()), Imager(ARRAY, QUIET)
    one = imager.plane(grid, np.eye(4)).envelope
    other = imager.plane(grid, turned_about_the_centre(30)).envelope
    # Line i of the turned plane runs where line i + 30 of the other does. The half of a table's step is what is lost.
    correlation = np.corrcoef(one[:, 45:-15].ravel(), other[:, 15:-45].ravel())[0, 1]
    assert correlation > 0.98
    apart = np.corrcoef(one[:, 15:-45].ravel(), other[:, 15:-45].ravel())[0, 1]
    assert abs(apart) < 0.05


def test_speckle_changes_over_the_thickness_of_the_slice():
    grid, imager = uniform_phantom(tissue()), Imager(ARRAY, QUIET)
    still = imager.plane(grid, np.eye(4)).envelope

    def correlation_at(shift_m):
        T = np.eye(4)
        T[1, 3] = shift_m
        moved = imager.plane(grid, T).envelope
        return np.corrcoef(still[400:700].ravel(), moved[400:700].ravel())[0, 1]

    thickness_m = beam.slice_fwhm_m(ARRAY, np.array([0.07]))[0]
    assert correlation_at(0.1 * thickness_m) > 0.9
    assert abs(correlation_at(2.5 * thickness_m)) < 0.1


def test_other_tissue_has_other_speckle_and_a_plane_repeats_to_the_byte():
    grid = uniform_phantom(tissue())
    image = Imager(ARRAY).plane(grid, np.eye(4), 3).image
    assert np.array_equal(image, Imager(ARRAY).plane(grid, np.eye(4), 3).image)
    other = Imager(ARRAY, Settings(tissue_seed=1)).plane(grid, np.eye(4), 3).image
    assert not np.array_equal(image, other)


def band_db(envelope, depths_mm, lines):
    """Mean power of a part of a plane [dB]."""
    first, last = (int(depth * 1e-3 / ARRAY.sample_m) for depth in depths_mm)
    return 10.0 * np.log10((envelope[first:last, lines] ** 2).mean())


def test_behind_a_cyst_echoes_are_enhanced_by_what_it_did_not_attenuate():
    liver = tissue(attenuation=0.5)
    cyst = tissue("cyst", attenuation=0.05, backscatter_db=-200.0)
    grid = ball_phantom(liver, cyst, centre_m=(0.0, 0.0, 0.05), radius_m=0.012)
    plane = Imager(ARRAY, QUIET).plane(grid, np.eye(4))
    beside_db = band_db(plane.envelope, (70, 110), slice(20, 60))
    behind_db = band_db(plane.envelope, (70, 110), slice(93, 99))
    # 24 mm of fluid in place of liver, there and back. A few cells of resolution vary by a decibel.
    assert behind_db - beside_db == pytest.approx(2.0 * 2.4 * 3.5 * 0.45, abs=1.5)
    assert band_db(plane.envelope, (45, 55), slice(93, 99)) < beside_db - 40.0


@pytest.mark.parametrize("name", ["bone", "gas", "calcification"])
def test_behind_bone_gas_and_calcification_nothing_is_left(name):
    grid = ball_phantom(TISSUES["liver"], TISSUES[name], centre_m=(0.0, 0.0, 0.05), radius_m=0.008)
    plane = Imager(ARRAY).plane(grid, np.eye(4))
    deep = int(0.1 / ARRAY.sample_m)
    # 16 mm of bone, there and back, are 56 dB and liver 6 dB of them.
    assert plane.left[deep, 96] < 3e-3 * plane.left[deep, 30]
    # The picture: a bright front, black behind it, and liver beside it.
    front = plane.envelope[int(0.040 / ARRAY.sample_m) : int(0.044 / ARRAY.sample_m), 96].max()
    assert front > 20.0 * np.sqrt((plane.envelope[300:320, 96] ** 2).mean())
    fan = Imager(ARRAY).fan
    row = int((0.09 - fan.top_m) / fan.pixel_m)
    assert plane.image[row - 20 : row + 20, 252:260].mean() < 10.0
    assert plane.image[row - 20 : row + 20, 130:150].mean() > 60.0


def test_the_echo_of_a_boundary_is_that_of_its_impedances_and_fades_with_the_angle():
    # A slab whose face is met at a right angle by the middle line only.
    labels = np.ones((161, 41, 161), np.uint8)
    labels[:, :, 60:] = 2
    above, below = (
        tissue(impedance=1.52, backscatter_db=-200.0),
        tissue(impedance=1.72, backscatter_db=-200.0),
    )
    origin_m = np.array([-0.08, -0.02, -0.01])
    grid = LabelGrid.from_labels([above, above, below], labels, origin_m=origin_m, spacing_m=0.001)
    plane = Imager(ARRAY, QUIET).plane(grid, np.eye(4))
    signal, left, _ = Imager(ARRAY, QUIET).trace(grid, np.eye(4))
    echoes = signal[..., 0]
    middle, at_a_slant = ARRAY.n_lines // 2, 10
    ratio = 0.2 / 3.24
    assert echoes[:, middle].max() * 10.0 ** (SPECKLE_DB / 20.0) == pytest.approx(ratio, rel=0.02)
    assert np.argmax(echoes[:, middle]) * ARRAY.sample_m == pytest.approx(0.0495, abs=2.0 * ARRAY.sample_m)
    assert echoes[:, at_a_slant].max() < 0.35 * echoes[:, middle].max()
    assert left[-1, middle] == pytest.approx(1.0 - ratio**2, rel=1e-5)
    assert plane.envelope[:, middle].argmax() == np.argmax(echoes[:, middle])


def test_a_line_that_lost_contact_is_dark_and_one_with_gel_before_the_organ_is_not():
    labels = np.zeros((161, 41, 161), np.uint8)
    labels[80:, :, 15:] = 1
    origin_m = np.array([-0.08, -0.02, -0.01])
    grid = LabelGrid.from_labels(
        [TISSUES["fat"], TISSUES["liver"]], labels, origin_m=origin_m, spacing_m=0.001
    )
    plane = Imager(ARRAY).plane(grid, np.eye(4))
    assert np.all(plane.left[400:, :80] == 0.0)
    # 5 mm of gel attenuate nothing.
    assert plane.left[30, 150] == pytest.approx(1.0, rel=1e-6)
    assert 0.0 < plane.left[400, 150] < plane.left[30, 150]


def test_noise_covers_what_lies_too_deep():
    deep = Imager(ARRAY).plane(uniform_phantom(tissue(attenuation=1.5)), np.eye(4))
    quiet = Imager(ARRAY, QUIET).plane(uniform_phantom(tissue(attenuation=1.5)), np.eye(4))
    noise_db = 10.0 * np.log10((deep.envelope[-200:] ** 2).mean())
    assert noise_db == pytest.approx(Settings().noise_db, abs=0.5)
    assert 10.0 * np.log10((quiet.envelope[-200:] ** 2).mean()) < noise_db - 20.0


@pytest.mark.parametrize("frequency_hz", [2.0e6, 7.0e6])
def test_speckle_is_fully_developed_and_of_the_same_level_at_other_frequencies(frequency_hz):
    array = ConvexArray(frequency_hz=frequency_hz, depth_m=0.06, focus_m=0.03, height_focus_m=0.04)
    envelope = envelopes(uniform_phantom(tissue()), 2, array)[:, 60:-60, LINES]
    assert envelope.mean() / envelope.std() == pytest.approx(1.913, rel=0.05)
    assert 10.0 * np.log10((envelope**2).mean()) == pytest.approx(0.0, abs=0.3)


def test_an_aperture_is_no_wider_than_the_face():
    wide = ConvexArray(face_width_m=0.01, aperture_m=0.04)
    narrow = ConvexArray(face_width_m=0.01, aperture_m=0.01)
    assert np.array_equal(
        beam.lateral_fwhm_m(wide, wide.depths_m), beam.lateral_fwhm_m(narrow, narrow.depths_m)
    )


def test_the_compensation_of_a_very_deep_picture_stays_finite():
    array = ConvexArray(frequency_hz=20e6, depth_m=0.4, n_lines=32, n_samples=256)
    plane = Imager(array).plane(uniform_phantom(tissue(attenuation=0.5)), np.eye(4))
    assert np.isfinite(plane.envelope).all()
    assert np.isfinite(Imager(array).gains).all()
