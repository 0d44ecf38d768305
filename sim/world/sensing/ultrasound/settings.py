"""What the machine is set to."""

from __future__ import annotations

from dataclasses import dataclass

from sim.errors import FieldError


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
    scatterers_per_cell: float = 6.0
    """Scatterers in a cell of resolution where it is smallest: pulse by beam by slice, at half of their amplitudes."""
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
        if not 0.5 <= self.scatterers_per_cell <= 100.0:
            raise FieldError("scatterers_per_cell", self.scatterers_per_cell, "must be from 0.5 to 100.")
