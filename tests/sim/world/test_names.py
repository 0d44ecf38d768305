"""Names of segments and objects, as people write them in their own languages."""

import unicodedata

import pytest

from sim.world.names import fold, is_generic, meaning_of, roles_of

NAMES = {
    "liver": [
        *("Liver", "LIVER_1", "Leber", "Foie", "Hígado", "Fegato", "Fígado", "Lever", "Wątroba", "Karaciğer"),
        *("KARACİĞER", "Печень", "肝脏", "肝臟", "肝臓", "간", "Lebersegment II", "liver parenchyma"),
        *("Leber ohne Tumor", "non-tumor liver", "foie sans tumeur", "здоровая печень без опухоли"),
    ],
    "tumour": [
        *(
            "tumor",
            "Tumour 1",
            "liver_tumor",
            "Lebertumor",
            "Läsion",
            "Laesion",
            "LÄSION",
            "Metastase",
            "Karzinom",
        ),
        *(
            "Lésion hépatique",
            "tumeur",
            "Métastase",
            "lesión",
            "nódulo",
            "cáncer",
            "lesione",
            "tumore",
            "lesão",
        ),
        *("câncer", "levertumor", "laesie", "kanker", "guz wątroby", "rak", "przerzut", "nowotwór", "tümör"),
        *(
            "LEZYON",
            "kanser",
            "Опухоль",
            "очаг",
            "метастаз печени",
            "肿瘤",
            "肝癌",
            "病灶",
            "腫瘍",
            "病変",
            "転移",
        ),
        *("종양", "간암", "병변", "HCC", "hcc_2", "CRLM", "mets", "ＴＵＭＯＲ"),
    ],
    "vessel": [
        *(
            "liver_vessels",
            "Lebervene",
            "Lebergefäße",
            "portal vein",
            "Pfortader",
            "veine hépatique",
            "肝静脉",
        ),
        *(
            "門脈",
            "간정맥",
            "сосуды печени",
            "naczynia wątroby",
            "gallbladder",
            "Gallenblase",
            "vasi epatici",
        ),
    ],
    "part": ["hepatic cyst", "Leberzyste", "kyste hépatique", "rib_left_6"],
    "other organ": ["kidney_left", "Niere", "rein gauche", "riñón", "pancreas", "почка", "腎臓", "spleen"],
    None: ["Segment_1", "Knochen", "background", "no tumor", "mammoth", "skin", "공간", "trakt", ""],
}


@pytest.mark.parametrize(
    ("name", "meaning"), [(name, meaning) for meaning, names in NAMES.items() for name in names], ids=str
)
def test_a_name_is_understood_with_its_accents_composed_or_apart(name, meaning):
    assert meaning_of(name) == meaning
    assert meaning_of(unicodedata.normalize("NFD", name)) == meaning
    assert meaning_of(fold(name)) == meaning


def test_names_that_programs_give_tell_nothing():
    for name in ("Segment_1", "Mesh_0", "label 12", "default", "Objekt.001", "g", "", "STL exported"):
        assert is_generic(name)
    for name in ("liver", "Läsion", "肝臓", "portal"):
        assert not is_generic(name)


def test_roles_follow_the_liver_then_the_one_other_organ_then_the_rest():
    roles = roles_of({1: "Leber", 2: "Läsion", 3: "Niere", 4: "Nierentumor"})
    assert (roles.organ, roles.tumours, roles.others) == ((1,), (2,), (3, 4))
    assert roles_of({1: "liver", 2: "kidney tumor"}).tumours == ()
    assert roles_of({1: "kidney", 2: "tumor"}).organ == (1,)
    assert roles_of({1: "kidney_left", 2: "kidney_right", 3: "tumor"}).organ == ()
    rest = roles_of({1: "Segment_1", 2: "tumor", 3: "vessel"})
    assert (rest.organ, rest.tumours, rest.others, rest.is_by_rest) == ((1,), (2,), (3,), True)
    assert roles_of({1: "liver_vessels", 2: "liver_tumor"}).organ == ()
    assert roles_of({1: "Segment_1", 2: "Segment_2"}).organ == ()
    assert roles_of({1: "Segment_1", 2: "Segment_2", 3: "tumor"}).organ == ()
