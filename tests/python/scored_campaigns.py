"""Campaigns and verdicts written by hand, whose scores are computed by hand."""

from blind_samples import diagnosis, effect, strength_of


def estimate(name):
    """Of an effect's strength."""
    return {"parameters": {strength_of(name): {"mean": 1.12, "ci90": [1.08, 1.16], "unit": "1"}}}


CAMPAIGNS = {
    # right, by its class: slenderness for table_gain
    "a": ("single", [effect("table_gain", 0.1, 3.0)]),
    # right, magnitude right: |1.12 - 1.16| / 0.16 = 0.25, its interval holds 1.16
    "b": ("single", [effect("restitution", 1.16, 5.0)]),
    # wrong, second in the list
    "c": ("single", [effect("friction", 0.8, 2.5)]),
    # missed: weak
    "d": ("single", [effect("inertia", 0.05, 0.7)]),
    "e": ("none", []),
    "f": ("none", []),
    "g": ("unknown", [effect("catch", 20.0)]),
    "h": ("unknown", [effect("wear")]),
    "i": ("pair", [effect("wear"), effect("friction")]),
}

VERDICTS = {
    "a": diagnosis(
        "class",
        {"slenderness": 0.5, "table_gain": 0.3, "friction": 0.1, "unknown": 0.05},
        ["slenderness", "table_gain"],
        ["slenderness", "table_gain"],
        closure=0.6,
        headline=0.4,
        gain=[0.1, 0.3],
        where=[{"place": "x", "axis": "conditions", "p_familywise": 0.01, "trials": ["T2"]}],
    ),
    "b": diagnosis(
        "effect",
        {"restitution": 0.9, "unknown": 0.1},
        ["restitution"],
        ["restitution", "rocking_damping"],
        restitution=estimate("restitution"),
    ),
    "c": diagnosis(
        "effect",
        {"restitution": 0.6, "friction": 0.3, "unknown": 0.1},
        ["restitution"],
        ["restitution", "friction", "wear"],
        friction=estimate("friction"),
    ),
    "d": diagnosis(
        "none", {"none": 0.8, "inertia": 0.1}, [], ["none"], closure=-0.2, gain=[-0.2, -0.1]
    ),
    # significant, but it does not stand out: no trials
    "e": diagnosis(
        "none",
        {"none": 0.9},
        [],
        ["none"],
        where=[{"place": "x", "axis": "order", "p_familywise": 0.04, "trials": None}],
    ),
    "f": diagnosis(
        "effect",
        {"none": 0.2, "wear": 0.8},
        ["wear"],
        ["wear"],
        where=[{"place": "x", "axis": "order", "p_familywise": 0.04, "trials": ["T1"]}],
    ),
    "g": diagnosis("unknown", {"unknown": 0.7, "wear": 0.2}, [], ["unknown"]),
    "h": diagnosis("unresolved", {"unknown": 0.1, "friction": 0.1}, [], ["friction"]),
    "i": diagnosis("pair", {"wear": 0.4, "friction": 0.4}, ["friction", "wear"], ["wear"]),
}
