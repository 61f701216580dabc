"""Sets of effects, and the rule that names what is probable enough."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from vsr2.diagnosis.verdict.statements import VerdictKind
from vsr2.effects import library as full_library
from vsr2.posterior.calibration import label_probability
from vsr2.posterior.naming import NAMING, Naming, NamingLimits, candidates, decide, is_wrong
from vsr2.posterior.sets import Sets, are_alike, classes, declared_alike

SETS = Sets(("a", "b", "c", "d"))

DISTINCT = np.eye(4, dtype=bool)


def test_sets_are_none_every_effect_every_pair_and_outside() -> None:
    assert len(SETS) == len(SETS.members) == 12
    wanted = [
        (),
        *((name,) for name in SETS.names),
        *itertools.combinations(SETS.names, 2),
        (),
    ]
    named = [tuple(np.array(SETS.names)[row]) for row in SETS.members]
    assert named == wanted
    assert [SETS.index(names) for names in wanted[:-1]] == list(range(11))
    assert SETS.index(("d", "b")) == SETS.index(("b", "d")) == 9
    assert SETS.outside == 11
    assert len(Sets(("a",))) == 3


@pytest.mark.parametrize("most", [1, 3, 4])
def test_sets_hold_at_most_so_many_effects(most) -> None:
    sets = Sets(SETS.names, most)
    wanted = [
        set(names) for size in range(most + 1) for names in itertools.combinations(sets.names, size)
    ]
    assert [set(np.array(sets.names)[row]) for row in sets.members[:-1]] == wanted
    np.testing.assert_array_equal(sets.size[:-1], [len(one) for one in wanted])
    assert len(sets) == len(wanted) + 1
    assert sets.index(sets.names[:most]) == wanted.index(set(sets.names[:most]))


def test_labels_share_all_of_the_probability() -> None:
    p = np.random.default_rng(0).dirichlet(np.ones(12), 5)
    labels = label_probability(p, SETS)
    np.testing.assert_allclose(labels.sum(axis=1), 1.0, rtol=1e-12)
    a = p[:, 1] + p[:, 5:8].sum(axis=1)
    np.testing.assert_allclose(SETS.marginal(p)[:, 0], a)
    np.testing.assert_array_equal(labels[:, [0, -1]], p[:, [0, 11]])


def test_the_effect_of_a_pair_that_acts_more_probably_leads() -> None:
    p = np.zeros((1, 12))
    for names, value in ((("a",), 0.4), (("a", "b"), 0.3), (("b", "c"), 0.2), (("c", "d"), 0.1)):
        p[0, SETS.index(names)] = value
    # They act with 0.7, 0.5, 0.3 and 0.1.
    np.testing.assert_allclose(label_probability(p, SETS)[0], [0, 0.7, 0.2, 0.1, 0, 0])
    three = Sets(SETS.names, 3)
    p = np.zeros((1, len(three)))
    for names, value in ((("a",), 0.2), (("a", "c"), 0.3), (("b", "c", "d"), 0.5)):
        p[0, three.index(names)] = value
    # They act with 0.5, 0.5, 0.8 and 0.5.
    np.testing.assert_allclose(label_probability(p, three)[0], [0, 0.2, 0, 0.8, 0, 0])


def test_sets_of_a_part_are_found_among_those_of_the_library() -> None:
    part = Sets(("d", "b"))
    place = part.within(SETS)
    assert place[-1] == SETS.outside
    for k in range(len(part) - 1):
        names = {name for name, held in zip(part.names, part.members[k], strict=True) if held}
        assert place[k] == SETS.index(names)


def test_a_class_is_an_effect_and_what_is_declared_alike_to_it() -> None:
    alike = DISTINCT.copy()
    for i, j in ((0, 1), (1, 2)):
        alike[i, j] = alike[j, i] = True
    assert classes([1, 0, 2], alike) == 1
    assert classes([0, 1, 2], alike) == 2, "twins of a twin are another class"
    assert classes([0, 2], alike) == 2
    assert classes([2, 3, 1, 0], alike) == 3
    assert classes([], alike) == 0
    library = full_library()
    declared = declared_alike(library)
    np.testing.assert_array_equal(declared, declared.T)
    names = list(library)
    assert declared[names.index("com_offset"), names.index("base_slope")]
    assert are_alike(library["base_slope"], library["com_offset"])
    assert not declared[names.index("com_offset"), names.index("wear")]


TWINS = DISTINCT.copy()

TWINS[0, 1] = TWINS[1, 0] = True


def probabilities(**given):
    """Of sets by their effects; what is left over is none's."""
    out = np.zeros(12)
    for names, value in given.items():
        out[SETS.outside if names == "outside" else SETS.index(names)] = value
    out[0] = 1 - out.sum()
    return out


def said(alike=DISTINCT, none_limit=0.3, least=0.8, **given):
    found = candidates(probabilities(**given), SETS, alike)
    naming = decide(found, NamingLimits(none_limit, least, least), alike)
    return str(naming.kind), tuple(SETS.names[e] for e in naming.effects), naming


def test_candidates_cover_the_sets_that_hold_one_of_them() -> None:
    p = probabilities(a=0.3, b=0.2, ab=0.1, bc=0.15, outside=0.05)
    found = candidates(p, SETS, DISTINCT)
    assert found.none == pytest.approx(0.2)
    assert found.outside == pytest.approx(0.05 / 0.8)
    # b first, as 0.45 lie in its sets; then a adds 0.3 alone.
    assert found.effects[:2] == (1, 0)
    np.testing.assert_allclose(found.covered[:2], [0.45 / 0.8, 0.75 / 0.8])
    ((findings, probability),) = found.together
    assert findings == ((1,), (2,))
    assert probability == pytest.approx(0.15 / 0.8), "given a gap"


@pytest.mark.parametrize(
    ("given", "kind", "effects"),
    [
        ({"a": 0.69}, "none", ()),
        ({"a": 0.71}, "effect", ("a",)),
        # Given a gap: 0.6 of 0.71 are more than 0.8.
        ({"a": 0.6, "c": 0.11}, "effect", ("a",)),
        ({"a": 0.5, "c": 0.3}, "class", ("a", "c")),
        ({"a": 0.3, "c": 0.3, "d": 0.3}, "class", ("a", "c", "d")),
        ({"a": 0.25, "b": 0.25, "c": 0.25, "d": 0.25}, "unresolved", ("a", "b", "c")),
        ({"a": 0.3, "outside": 0.5}, "unknown", ()),
        # A cause outside the library would make the name wrong.
        ({"a": 0.7, "outside": 0.1}, "effect", ("a",)),
        ({"a": 0.5, "outside": 0.3}, "unresolved", ("a",)),
        ({"bd": 0.85, "b": 0.1}, "pair", ("b", "d")),
        ({"bd": 0.6, "b": 0.3}, "effect", ("b",)),
    ],
)
def test_one_rule_makes_every_kind_of_statement(given, kind, effects) -> None:
    found_kind, found, naming = said(**given)
    assert found_kind == kind
    assert found == effects
    if kind in ("effect", "class"):
        assert naming.probability >= 0.8
        assert naming.classes == len(effects)
        assert not naming.alike


def test_twins_are_named_together_and_count_as_one_class() -> None:
    kind, effects, naming = said(TWINS, a=0.85, b=0.1)
    assert (kind, effects, naming.alike) == ("class", ("a", "b"), True)
    assert naming.probability == pytest.approx(1.0)
    # Not where another comes next, nor where they are not declared alike.
    assert said(TWINS, a=0.85, c=0.1)[:2] == ("effect", ("a",))
    assert said(DISTINCT, a=0.85, b=0.1)[:2] == ("effect", ("a",))
    kind, effects, naming = said(TWINS, a=0.25, b=0.25, c=0.25, d=0.25, least=0.9)
    assert (kind, len(effects), naming.classes) == ("class", 4, NAMING.classes)
    assert not naming.alike


def test_an_effect_of_no_probability_is_never_put_forward() -> None:
    """What was excluded has none: it must neither lead nor stand beside its twin."""
    for given in ({"a": 0.5, "outside": 0.4}, {"a": 0.95}, {"a": 0.5, "c": 0.45}):
        for least in (0.8, 1.1):
            _, effects, _ = said(TWINS, least=least, **given)
            assert set(effects) == set(given) - {"outside"}


def test_causes_that_act_together_are_named_with_their_twins() -> None:
    """a and b are twins: that c acts with one of them is sure, with which one is not."""
    kind, effects, naming = said(TWINS, ac=0.5, bc=0.4)
    assert (kind, effects, naming.findings) == ("pair", ("a", "b", "c"), ((0, 1), (2,)))
    assert naming.probability == pytest.approx(1.0)
    assert said(DISTINCT, ac=0.5, bc=0.4)[:2] == ("effect", ("c",))
    assert said(TWINS, ac=0.75, bc=0.15)[2].findings == ((0,), (2,)), "no more than needed"


def test_the_most_causes_are_named_that_act_together() -> None:
    three = Sets(SETS.names, 3)

    def of(**given):
        p = np.zeros(len(three))
        for names, value in given.items():
            p[three.index(names)] = value
        p[0] = 1 - p.sum()
        found = candidates(p, three, DISTINCT)
        return decide(found, NamingLimits(0.3, 0.8, 0.8), DISTINCT)

    every = of(abc=0.85, ab=0.1)
    assert (every.kind, every.findings) == (VerdictKind.SEVERAL, ((0,), (1,), (2,)))
    some = of(acd=0.5, bcd=0.4)
    assert (some.kind, some.findings) == (VerdictKind.PAIR, ((2,), (3,)))
    assert some.probability == pytest.approx(1.0)


def test_causes_that_act_together_have_a_limit_of_their_own() -> None:
    found = candidates(probabilities(a=0.55, ab=0.35), SETS, DISTINCT)

    def kind(one, together):
        return str(decide(found, NamingLimits(0.3, one, together), DISTINCT).kind)

    assert kind(0.8, 0.35) == "pair"
    assert kind(0.8, 0.5) == "effect"


def test_a_name_is_wrong_where_none_of_it_acts() -> None:
    def one(kind, *effects):
        findings = tuple((e,) for e in effects) if kind == "pair" else (effects,)
        return Naming(VerdictKind(kind), findings, 0.9)

    assert not is_wrong(one("class", 0, 2), (2, 3))
    assert is_wrong(one("class", 0, 2), (1,))
    assert is_wrong(one("effect", 0), ())
    assert not is_wrong(one("pair", 0, 2), (2, 0))
    assert is_wrong(one("pair", 0, 2), (0,))
    for kind in ("none", "unknown", "unresolved"):
        assert not is_wrong(one(kind, 1), (0,))
