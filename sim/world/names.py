"""What the names of segments and objects mean: which of them is the organ, which are tumours, and which neither.

People name what they outline in their own language, with accents or without, in one word or several. Long words are
found within longer ones, as in `Lebertumor`; short ones only by themselves, as `rak` in `rak wątroby`.
"""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Hashable, Mapping
from dataclasses import dataclass
from typing import Generic, Literal, TypeVar

Meaning = Literal["liver", "other organ", "tumour", "vessel", "part"]
"""What a name says: the liver, another organ, a tumour in one, a vessel or duct, or another part such as a cyst."""

Key = TypeVar("Key", bound=Hashable)

LIVER = """
    liver leber foie higado fegato figado lever watrob karaciger печен 肝 간 hepar parenchym паренхим
"""

ANY_ORGAN = "organ orgaan organe organo organi organu орган 臓器 器官 장기"

OTHER_ORGANS = """
    kidney niere rein reins rinon rinones rene reni rim rins nier nieren nerka nerki bobrek почк 肾 腎 신장 콩팥 renal
    pancreas pankreas trzustk поджелуд 胰 膵 췌장
    spleen milz rate bazo milza baco milt sledzion dalak селезен 脾 비장
    lung lunge poumon pulmon polmone pulmao pluc akciger легк 肺 폐
    prostat uterus brain gehirn breast thyroid schilddruse mamma stomach magen heart herz
"""

TUMOURS = """
    tumor tumour tumeur tumori tumore tumoral tumoraal tumorlu опухол 肿瘤 腫瘤 腫瘍 瘤 종양
    lesion lesione lesao lesoes laesie lasion laesion lezyon letsel zmian ognisk поражен очаг 病灶 病变 病變 病変 병변
    cancer cancro kanker kanser krebs rak nowotwor рак 癌 がん ガン 암 간암 carcinom karzinom carcinoom karsinom
    metasta uitzaaiing przerzut метаста 转移 轉移 転移 전이 malign adenoma adenom neoplas
    nodul knoten rundherd herd herde knobbel gezwel guz guzek guzy guza kitle geschwulst raumforderung узел узл
    结节 結節 결절 образован новообразован
    hcc hccs ccc icc crlm crlms met mets gtv mass masse masa massa hemangiom hamangiom
"""

VESSELS = """
    vessel vein vena venae venas vene venen lebervene veine veines artery arteri aorta porta portal portae portale
    pfortader gefass gefaess blutgefass bloedvat vaten vasos vaisseau vaisseaux vasi vascul vaskul ader aderen naczyn
    zyla zyly tetnic damar toplardamar сосуд вена вены венозн артери воротн 血管 静脉 靜脈 静脈 动脉
    動脈 门脉 門脈 혈관 정맥 동맥 문맥 ivc vci
    duct gang gange bile biliar biliair bilir gall galle gallbladder gallenblase vesicul vesicola
    colecist galblaas zolc safra желч 胆 膽 담낭 담관 쓸개 cholecyst
"""

PARTS = """
    cyst kyste kysten zyste quiste cisti cisto cista kist torbiel кист 囊肿 囊腫 嚢胞 낭종
    ligament fissur fossa capsul kapsel thromb lymph bladder stent needle catheter ablation drain rib ribs vertebra
"""

NEGATIONS = """
    no non not without minus excluding excluded excl free healthy normal ohne nicht frei gesund sans hors sain
    sin sano senza sem saudavel zonder gezond bez zdrow без здоров 無 无 非 除 正常
"""

GENERIC = re.compile(
    r"(segment|segmentation|label|class|region|roi|structure|mesh|object|objekt|objet|oggetto|objeto|body|group|"
    r"default|solid|part|unnamed|untitled|node|root|geometry|material|element|instance|ascii|volume|surface|model|"
    r"shape|mask|scene|world|exported|slicer|binary|stl|obj|output|layer|g|o|s)*\d*"
)
"""Names that programs give by themselves."""

SHORTEST_WITHIN = {"latin": 5, "cyrillic": 4}
"""Letters from which on a word of an alphabet is found within longer ones."""

LETTERS_APART = str.maketrans({"ł": "l", "ı": "i", "ø": "o", "đ": "d", "æ": "ae", "œ": "oe", "ё": "е"})
"""Letters that Unicode does not take apart into a plain one and an accent."""


def fold(name: str) -> str:
    """A name in small letters without accents, in which full-width letters are plain ones."""
    small = unicodedata.normalize("NFKC", name).casefold().translate(LETTERS_APART)
    bare = "".join(each for each in unicodedata.normalize("NFD", small) if not "\u0300" <= each <= "\u036f")
    return unicodedata.normalize("NFC", bare)


def _words(text: str) -> tuple[str, ...]:
    return tuple(fold(word) for word in text.split())


VOCABULARY: dict[Meaning, tuple[str, ...]] = {
    "tumour": _words(TUMOURS),
    "vessel": _words(VESSELS),
    "part": _words(PARTS),
    "liver": _words(LIVER),
    "other organ": _words(f"{ANY_ORGAN} {OTHER_ORGANS}"),
}
"""Words by meaning, in the order in which the meanings take precedence."""

NEGATED = _words(NEGATIONS)


def meaning_of(name: str) -> Meaning | None:
    """What a name says, None if nothing that is known."""
    found = _meanings(fold(name))
    return next((meaning for meaning in VOCABULARY if meaning in found), None)


def is_no_liver(name: str) -> bool:
    """Whether a name is that of an organ other than the liver; one called just an organ may be a liver."""
    folded = fold(name)
    return meaning_of(name) == "other organ" and any(_holds(folded, word) for word in _words(OTHER_ORGANS))


def _meanings(folded: str) -> set[Meaning]:
    """All that the words of a folded name say."""
    found: set[Meaning] = set()
    for meaning, words in VOCABULARY.items():
        if any(_holds(folded, word) for word in words):
            found.add(meaning)
    if "tumour" in found and any(_holds(folded, word) for word in NEGATED):
        # "The liver without its tumours" is the liver; "no tumour" is nothing.
        found.discard("tumour")
    return found


def _holds(folded: str, word: str) -> bool:
    """Whether a folded name holds a word of the vocabulary, by itself or, where it is long enough, in a longer one."""
    tokens = [part for part in re.split(r"[\W\d_]+", folded) if part]
    if "가" <= word[0] <= "힣" and len(word) == 1:
        return any(token.startswith(word) for token in tokens)
    # Chinese and Japanese put no blanks between words.
    is_alphabetic = word.isascii() or "а" <= word[0] <= "я"
    if not is_alphabetic or len(word) >= SHORTEST_WITHIN["latin" if word.isascii() else "cyrillic"]:
        return word in folded
    return word in tokens


def is_generic(name: str) -> bool:
    """Whether a name is one that a program gives by itself, such as `Segment_3`, and tells nothing."""
    return GENERIC.fullmatch("".join(re.split(r"[\W_]+", fold(name)))) is not None


@dataclass(frozen=True, kw_only=True)
class Roles(Generic[Key]):
    """What each of several named things is.

    Attributes:
        organ: Those that are the organ; none if the names do not tell.
        tumours: Those that are tumours.
        others: All the rest.
        is_by_rest: Whether the organ is what is left once tumours and parts are taken away.
    """

    organ: tuple[Key, ...] = ()
    tumours: tuple[Key, ...] = ()
    others: tuple[Key, ...] = ()
    is_by_rest: bool = False


def roles_of(names: Mapping[Key, str]) -> Roles[Key]:
    """Which of several named things is the organ and which are tumours.

    Where no name is the liver's, another organ is taken if it is the only one, and then what is neither tumour nor
    part, if it is the only one beside tumours.

    Args:
        names: Names by whatever tells the things apart.
    """
    meanings: dict[Key, Meaning | None] = {key: meaning_of(name) for key, name in names.items()}
    tumours = _of(meanings, "tumour")
    organ, is_by_rest = _of(meanings, "liver"), False
    if organ:
        # A tumour that is named after another organ is none of the liver's.
        tumours = tuple(key for key in tumours if _meanings(fold(names[key])) != {"tumour", "other organ"})
    else:
        organ = _of(meanings, "other organ")
        if not organ and tumours:
            organ, is_by_rest = _of(meanings, None), True
        organ = organ if len(organ) == 1 else ()
    others = tuple(key for key in names if key not in (*organ, *tumours))
    return Roles(organ=organ, tumours=tumours, others=others, is_by_rest=is_by_rest and bool(organ))


def _of(meanings: Mapping[Key, Meaning | None], wanted: Meaning | None) -> tuple[Key, ...]:
    return tuple(key for key, meaning in meanings.items() if meaning == wanted)
