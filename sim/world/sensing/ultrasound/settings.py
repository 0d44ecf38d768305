"""What the machine is set to."""

from __future__ import annotations

from dataclasses import dataclass

from sim.errors import FieldError

from .scattering import N_PER_CUBE


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What the machine is set to, and how finely the tissue is strewn with scatterers."""

    gain_db: float = 0.0
    """Gain of all depths [dB]."""
    tgc_db_cm_mhz: float = 0.5
    """Attenuation that the time-gain compensation makes up for [dB/cm/MHz]; that of liver by default."""
    range_db: float = 60.0
    """Dynamic range: how far below white black begins [dB]."""
    noise_db: float = -65.0
    """The receiver's noise against liver's speckle at the face [dB], which the compensation raises with depth."""
    contact_gap_m: float = 0.010
    """Widest gap between the face and the organ [m], which gel and the soft organ fill; beyond it a line is dark."""
    scatterer_spacing_m: float = 0.00055
    """Distance of scatterers, of which the cube of this edge holds one in the mean [m]."""
    tissue_seed: int = 0
    """Which scatterers the tissue has."""
    n_pixels: int = 512
    """Pixels along each edge of the picture."""

    def __post_init__(self) -> None:
        """Checks the ranges."""
        if not 10.0 <= self.range_db <= 200.0:
            raise FieldError("dynamic_range_db", self.range_db, "must be from 10 to 200.")
        if not 0.0 <= self.tgc_db_cm_mhz <= 10.0:
            raise FieldError("tgc_db_cm_mhz", self.tgc_db_cm_mhz, "must be from 0 to 10.")
        if not 0.0001 <= self.scatterer_spacing_m <= 0.005:
            raise FieldError("scatterer_spacing_mm", self.scatterer_spacing_m * 1e3, "must be from 0.1 to 5.")

    @property
    def cube_m(self) -> float:
        """Edge of the cubes that hold `N_PER_CUBE` scatterers each [m]."""
        return self.scatterer_spacing_m * N_PER_CUBE ** (1.0 / 3.0)
