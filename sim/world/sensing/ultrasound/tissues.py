"""How tissues sound: impedance, attenuation and backscatter, and which tissue a structure's name means.

Impedances and attenuations of liver, fat, blood, muscle and bone are those of the material table of NVIDIA's Isaac for
Healthcare ray tracer (raysim). The attenuation of liver agrees with the 0.47-0.52 dB/cm/MHz measured in vivo (PubMed
3279691 and 6539974), and that of tumours is of primary ones (Ultrasound Med Biol 2021). Impedances of tumours, of what
is soft, of fluid, gel and gas, and the attenuation of calcifications, which have to shadow, are choices near these.
Backscatter has no agreed table: it is the contrast to liver that a picture shows, and the values are choices of what
a sonographer calls by the name.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from sim.errors import FieldError
from sim.suggestions import did_you_mean
from sim.world.names import fold, meaning_of
from sim.world.solids.solid import Solid

from ..errors.echogenicity import MIXED, echogenicity_of

SILENT_DB = -120.0
"""Backscatter of what has no scatterers, against liver [dB]."""


@dataclass(frozen=True, kw_only=True)
class Tissue:
    """How one tissue sounds."""

    name: str
    """What it is called in options."""
    impedance_mrayl: float
    """Acoustic impedance, density times speed of sound [MRayl = 1e6 kg/(m^2 s)]."""
    attenuation_db_cm_mhz: float
    """Attenuation of a one-way path, taken to grow linearly with frequency [dB/cm/MHz]."""
    backscatter_db: float
    """Mean power of its speckle against that of liver [dB]."""

    def attenuation_db_m(self, frequency_hz: float) -> float:
        """Attenuation of a one-way path at a frequency [dB/m]."""
        return self.attenuation_db_cm_mhz * 100.0 * frequency_hz * 1e-6


def _table(*rows: tuple[str, float, float, float]) -> dict[str, Tissue]:
    return {
        name: Tissue(
            name=name,
            impedance_mrayl=impedance,
            attenuation_db_cm_mhz=attenuation,
            backscatter_db=backscatter,
        )
        for name, impedance, attenuation, backscatter in rows
    }


TISSUES = _table(
    ("gel", 1.52, 0.0, SILENT_DB),
    ("soft-tissue", 1.63, 0.60, -2.0),
    ("liver", 1.65, 0.50, 0.0),
    ("hypoechoic", 1.67, 0.87, -9.0),
    ("isoechoic", 1.66, 0.60, -0.5),
    ("hyperechoic", 1.68, 0.87, 7.0),
    ("blood", 1.61, 0.18, -28.0),
    ("fluid", 1.55, 0.05, SILENT_DB),
    ("fat", 1.38, 0.63, 3.0),
    ("muscle", 1.70, 1.09, -4.0),
    ("bone", 7.80, 5.00, -30.0),
    ("calcification", 5.00, 20.00, -30.0),
    ("gas", 0.0004, 12.0, SILENT_DB),
)
"""The tissues by name. Fluid is bile and what fills a cyst; gel couples the array's face to the organ."""

DEFAULT_STRUCTURE = "soft-tissue"
"""The tissue of a structure whose name tells none."""

WORDS = {
    "bone": "bone rib ribs rippe rippen costa vertebra vertebrae wirbel sternum spine iliac pelvis knochen os",
    "calcification": "calcification calcified calcium kalk stone stones calculus clip stent needle coil applicator",
    "gas": "gas air luft lung lungs lunge bowel colon duodenum pneumo",
    "fat": "fat fett adipose omentum",
    "muscle": "muscle muskel diaphragm diaphragma psoas",
    "fluid": "cyst zyste kyste gallbladder gallenblase bile duct ascites fluid bladder biloma",
    "hypoechoic": "hypoechoic",
    "isoechoic": "isoechoic",
    "hyperechoic": "hyperechoic hemangioma haemangioma ligament ligamentum fissure",
}
"""Words of structures' names by the tissue that they mean; a vessel's are those of `sim.world.names`."""


BY_LESION = "by-lesion"
"""In the place of the tumours' tissue: each lesion has a look of its own."""
CORE = 0.6
"""Size of the bright core of a lesion of both kinds, as a share of the lesion's."""


def lesion_bodies(lesions: Iterable[Solid], tissue: str) -> list[tuple[Solid, Tissue]]:
    """The bodies of lesions with the tissue of each, those within others last.

    Args:
        lesions: The lesions.
        tissue: The tissue of all, or `BY_LESION`: then each looks as `echogenicity_of` draws it once and for all, and
            one of both kinds is hypoechoic with a hyperechoic core.

    Raises:
        FieldError: There is no such tissue.
    """
    if tissue != BY_LESION:
        return [
            (solid, tissue_named(tissue, field="tumour_tissue", others=(BY_LESION,))) for solid in lesions
        ]
    bodies = []
    for solid in lesions:
        look = echogenicity_of(solid)
        bodies.append((solid, TISSUES["hypoechoic" if look is MIXED else look.name]))
        if look is MIXED:
            middle_m = solid.bounds_m.mean(axis=0)
            core = Solid(middle_m + CORE * (solid.vertices_m - middle_m), solid.faces)
            bodies.append((core, TISSUES["hyperechoic"]))
    return bodies


def tissue_named(name: str, *, field: str, others: tuple[str, ...] = ()) -> Tissue:
    """The tissue of a name.

    Args:
        name: A name of `TISSUES`.
        field: The option that named it, for the error.
        others: What else the option takes, for the error.

    Raises:
        FieldError: There is no such tissue.
    """
    if name not in TISSUES:
        known = (*TISSUES, *others)
        remedy = f"choose a tissue: {', '.join(known)}.{did_you_mean(name, known)}"
        raise FieldError(field, name, remedy)
    return TISSUES[name]


def tissue_of_structure(name: str, given: dict[str, str] | None = None) -> Tissue:
    """The tissue of a structure.

    Args:
        name: The structure's name.
        given: Tissues by structure's name, which take precedence over what the name says.

    Returns:
        What `given` says, and else what a word of the name says: a vessel is blood, a rib bone. A name that tells
        nothing is `DEFAULT_STRUCTURE`.

    Raises:
        FieldError: `given` names no tissue.
    """
    if given and name in given:
        return tissue_named(given[name], field="structure_tissue")
    tokens = fold(name).replace("_", " ").replace("-", " ").replace(".", " ").split()
    for tissue, words in WORDS.items():
        if any(token.rstrip("0123456789") in words.split() for token in tokens):
            return TISSUES[tissue]
    return TISSUES["blood" if meaning_of(name) == "vessel" else DEFAULT_STRUCTURE]
