"""What words of English and German logs and models mean. One table: whoever meets a word that is missing adds it here."""

from __future__ import annotations

from functools import cache

COMMAND, MEASURED = "command", "measured"
"""Meanings of words that say whether a signal was asked for or happened."""
PLACES = {
    **{"front": "rear", "left": "right", "upper": "lower", "inner": "outer"},
    **{"rear": "front", "right": "left", "lower": "upper", "outer": "inner"},
}
"""Meanings of words for a place of a machine, and the other place."""
_MEANINGS = {
    COMMAND: (
        "soll sollwert set setpoint ref reference cmd command commanded demand demanded target desired vorgabe stell "
        "stellwert stellgroesse fuehrungsgroesse"
    ),
    MEASURED: (
        "ist istwert actual meas measured messung messwert geber drehgeber sensor laser encoder aufnehmer transducer tacho"
    ),
    "front": "vorn vorne vorder vordere",
    "rear": "hinten hinter hintere",
    "left": "links linke linker",
    "right": "rechts rechte rechter",
    "upper": "top oben ober obere",
    "lower": "bottom unten unter untere",
    "inner": "innen innere",
    "outer": "aussen aeussere",
    "acceleration": "acc accel beschleunigung beschl",
    "actuator": "zylinder cylinder aktor aktuator",
    "angle": "winkel",
    "axle": "achse",
    "body": "kasten wagenkasten aufbau",
    "bogie": "drehgestell",
    "crane": "kran",
    "current": "strom",
    "damper": "daempfer",
    "force": "kraft",
    "force measured": "messdose",
    "frame": "rahmen",
    "gear": "getriebe",
    "load": "last",
    "mass": "masse",
    "motor": "antrieb",
    "pendulum": "pendel",
    "pitch": "nick",
    "position": "pos lage",
    "pressure": "druck",
    "piston": "kolben",
    "road": "strasse fahrbahn",
    "roll": "wank",
    "rope": "seil",
    "shaft": "welle",
    "shaft torque measured": "messwelle",
    "speed": "velocity vel drehzahl geschwindigkeit geschw",
    "spring": "feder",
    "suspension travel": "federweg",
    "temperature": "temp temperatur",
    "torque": "trq moment drehmoment tau",
    "travel": "weg hub",
    "trolley": "crab katze laufkatze",
    "wheelset": "radsatz",
    "yaw": "gier",
}
"""Words by what they mean. Umlauts are written out, as guess.words has them."""
_OF = {word: meaning.split() for meaning, known in _MEANINGS.items() for word in (*known.split(), meaning)}
LETTERS, REST = 4, 3
"""Letters from which a part of a compound is known whatever the rest is (`Solldurchfluss`), and those that the rest has at
least; a shorter one (`ist`) is one beside a known part alone: `twist` and `offset` are no compounds."""


@cache
def meaning(word: str) -> tuple[str, ...]:
    """What a word means, part by part of a compound, numbers behind it kept; the word itself where nobody knows."""
    bare = word.rstrip("0123456789")
    *parts, last = _OF.get(bare) or _compound(bare) or [bare]
    return (*parts, last + word[len(bare) :])


def _compound(word: str) -> list[str]:
    """`Sollwinkel`: command angle. Parts that are all known come first; [] for no compound."""
    for enough in (2, 1):
        for cut in range(len(word) - REST, REST - 1, -1):
            parts = word[:cut], word[cut:]
            known = [part for part in parts if part in _OF]
            if len(known) >= enough and (enough == 2 or len(known[0]) >= LETTERS):
                return [found for part in parts for found in _OF.get(part) or _compound(part) or [part]]
    return []
