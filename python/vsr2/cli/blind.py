"""`vsr2 blind`: make, diagnose and score packs of campaigns whose effect is withheld."""

from __future__ import annotations

import argparse
from dataclasses import fields
from pathlib import Path
from typing import Any


def add_verbs(verbs: Any) -> None:
    """Add `blind` with its own verbs."""
    blind = verbs.add_parser(
        "blind",
        help="check the diagnosis on campaigns whose effect is withheld",
        description="A custodian makes a pack and seals the answer; the diagnosis gets the data "
        "alone; scoring opens the key. docs/reference/blind.md describes the forms and the duties.",
    )
    own = blind.add_subparsers(dest="blind_verb", metavar="VERB", required=True)
    _add_make(own)
    _add_diagnose(own)
    _add_score(own)


def _add_make(verbs: Any) -> None:
    from vsr2.blind.form.pack_settings import ENGINES, PackSettings

    defaults = {f.name: f.default for f in fields(PackSettings)}
    make = verbs.add_parser(
        "make",
        help="draw, simulate and seal a pack",
        description="Writes PACK/data and the key folder. Stopped, the same command continues.",
    )
    make.add_argument("scene", metavar="SCENE.yaml", type=Path, help="study with the nominal scene")
    make.add_argument("pack", metavar="PACK", type=Path, help="folder of the pack")
    make.add_argument(
        "--key",
        type=Path,
        metavar="DIR",
        help="folder of the key, outside PACK/data (default: PACK-key, beside PACK)",
    )
    make.add_argument(
        "--engine",
        action="append",
        choices=ENGINES,
        help="may be repeated (default mujoco)",
    )
    for name, what in (
        ("single", "campaigns with one effect"),
        ("none", "campaigns without any"),
        ("pair", "campaigns with two effects"),
        ("unknown", "campaigns whose effect the diagnosis may not use"),
    ):
        make.add_argument(
            f"--{name}",
            type=int,
            nargs="+",
            metavar="N",
            help=f"{what}; for each engine, or one number for all (default {defaults[name]}, "
            "0 with --leave-one-out)",
        )
    for name, what in (
        ("trials", "trials a campaign"),
        ("motions", "ground motions a campaign"),
        ("sessions", "sessions a campaign"),
        ("catalogue", "ground motions of the pack"),
        ("protocols", "of the pack: campaigns of one share amplitudes, order and motions"),
        ("hidden", "effect classes that may be left out of the library"),
        ("replicates", "draws of nuisances with and without an effect that measure its signal"),
        ("signal_trials", "trials on which signals are measured"),
    ):
        make.add_argument(
            f"--{name.replace('_', '-')}",
            type=int,
            default=defaults[name],
            metavar="N",
            help=f"{what} (default {defaults[name]})",
        )
    make.add_argument(
        "--leave-one-out",
        type=int,
        metavar="N",
        help="N campaigns of kind unknown for every effect that reaches its detection limit, "
        "beside what is asked for of the kinds above",
    )
    make.add_argument(
        "--series-interval",
        type=float,
        default=defaults["series_interval"],
        metavar="S",
        help=f"of the series [s]; 0: none, tiers B and M alone "
        f"(default {defaults['series_interval']})",
    )
    make.add_argument(
        "--effect",
        action="append",
        default=[],
        metavar="NAME",
        help="draw only this effect (may be repeated; default: all)",
    )
    make.add_argument(
        "--development", action="store_true", help="an open pack: scored as often as you like"
    )
    make.add_argument(
        "--seed",
        type=int,
        help="of an open pack; the others have theirs from the operating system, so that nobody "
        "can draw the answer again",
    )
    make.add_argument("--quiet", action="store_true")
    make.set_defaults(run=_make)


def _add_diagnose(verbs: Any) -> None:
    from vsr2.blind.pack_diagnoses import DRAWS

    diagnose = verbs.add_parser(
        "diagnose",
        help="run the diagnosis over a pack's data folder",
        description="Reads the data folder alone. Stopped, the same command continues.",
    )
    diagnose.add_argument("data", metavar="DATA", type=Path, help="a pack's data folder")
    diagnose.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="DIR",
        help="folder of the diagnoses and of the cache of simulations",
    )
    diagnose.add_argument(
        "--tier", action="append", choices=["B", "M", "T"], help="may be repeated (default: all)"
    )
    diagnose.add_argument(
        "--campaign", action="append", metavar="ID", help="may be repeated (default: all)"
    )
    budget = diagnose.add_mutually_exclusive_group()
    budget.add_argument(
        "--draws",
        type=int,
        default=DRAWS,
        metavar="N",
        help="simulated campaigns of every effect; campaigns of one protocol use the same ones "
        f"(default {DRAWS})",
    )
    budget.add_argument(
        "--budget-minutes",
        type=float,
        metavar="MIN",
        help="of each diagnosis instead, for packs whose campaigns have motions of their own",
    )
    diagnose.add_argument("--threads", type=int, help="default: all this process may use")
    diagnose.add_argument("--seed", type=int, default=0, help="of each diagnosis (default 0)")
    diagnose.add_argument("--quiet", action="store_true")
    diagnose.set_defaults(run=_diagnose)


def _add_score(verbs: Any) -> None:
    score = verbs.add_parser(
        "score",
        help="open the key and score the diagnoses, once",
        description="Verifies the hashes of key and data, writes scores.json, scores.md and "
        "reliability.png, and leaves a receipt in the key folder: from then on no other diagnoses "
        "of the pack are scored.",
    )
    score.add_argument("data", metavar="DATA", type=Path, help="a pack's data folder")
    score.add_argument("key", metavar="KEY", type=Path, help="its key folder")
    score.add_argument(
        "diagnoses", metavar="DIAGNOSES", type=Path, help="what `vsr2 blind diagnose` wrote"
    )
    score.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder that gets the scores"
    )
    score.add_argument(
        "--tier",
        action="append",
        choices=["B", "M", "T"],
        help="score this tier alone (may be repeated; default: all of the pack, which must have "
        "been diagnosed)",
    )
    score.add_argument(
        "--train",
        nargs=2,
        type=Path,
        metavar=("DATA", "KEY"),
        help="a development pack that trains the trivial baselines",
    )
    score.set_defaults(run=_score)


def _make(options: argparse.Namespace) -> int:
    from vsr2.blind import PackSettings, make_pack
    from vsr2.blind.form.pack_settings import KINDS
    from vsr2.config import load_study
    from vsr2.diagnosis.observed.observations import OBSERVED
    from vsr2.errors import BlindError

    if options.seed is not None and not options.development:
        raise BlindError("--seed: only for open packs; add --development, or leave it out")
    names = ["trials", "motions", "sessions", "catalogue", "protocols", "hidden"]
    names += ["replicates", "signal_trials", "series_interval", "development"]
    chosen = {name: getattr(options, name) for name in names}
    for name, value, least in (
        ("trials", options.trials, OBSERVED.least_trials),
        ("motions", options.motions, OBSERVED.least_motions),
    ):
        if value < least:
            raise BlindError(
                f"--{name} is {value}; `vsr2 blind diagnose` takes campaigns of {least} or more"
            )
    for name in KINDS:
        given = getattr(options, name)
        if given is not None:
            chosen[name] = given[0] if len(given) == 1 else tuple(given)
        elif options.leave_one_out is not None:
            chosen[name] = 0
    if options.leave_one_out is not None:
        chosen["leave_one_out"] = options.leave_one_out
    settings = PackSettings(
        engines=tuple(dict.fromkeys(options.engine or ["mujoco"])),
        effects=tuple(options.effect),
        **chosen,
    )
    full = options.pack.resolve()
    if not full.name:
        raise BlindError(f"{options.pack}: has no name that the key's folder could have; add --key")
    made = make_pack(
        load_study(options.scene),
        options.pack,
        options.key or full.with_name(f"{full.name}-key"),
        settings,
        seed=options.seed,
        say=(lambda text: None) if options.quiet else (lambda text: print(text, flush=True)),
    )
    print(f"{options.pack / 'data'}: {made.campaigns} campaigns, sealed as {made.commitment}")
    for engine, effects in made.not_drawn.items():
        if effects:
            print(
                f"{engine}: no magnitudes from 0.5 to 6 detection limits, not drawn: "
                f"{', '.join(effects)}"
            )
    for engine, refused in made.refused.items():
        if refused:
            listed = ", ".join(f"{name} ({count})" for name, count in refused.items())
            print(
                f"{engine}: every draw measured outside 0.5 to 6 detection limits, not drawn for "
                f"so many campaigns: {listed}"
            )
    return 0


def _diagnose(options: argparse.Namespace) -> int:
    from vsr2.blind import DiagnosisOptions, diagnose_pack

    progress = diagnose_pack(
        options.data,
        options.out,
        tiers=options.tier,
        campaigns=options.campaign,
        options=DiagnosisOptions(
            draws=options.draws if options.budget_minutes is None else None,
            budget_minutes=10.0 if options.budget_minutes is None else options.budget_minutes,
            threads=options.threads,
            seed=options.seed,
        ),
        say=(lambda text: None) if options.quiet else (lambda text: print(text, flush=True)),
    )
    print(f"{options.out}: {progress.done} diagnoses, {len(progress.failed)} failed")
    return 1 if progress.failed else 0


def _score(options: argparse.Namespace) -> int:
    from vsr2.blind import score_pack
    from vsr2.blind.scoring.tables import format_scores

    scored = score_pack(
        options.data,
        options.key,
        options.diagnoses,
        options.out,
        training=None if options.train is None else tuple(options.train),
        tiers=options.tier,
        say=lambda text: print(text, flush=True),
    )
    print(format_scores(scored), end="")
    print(f"wrote {options.out}")
    return 0
