"""The custodian: draws, simulates and seals a pack of campaigns."""

from __future__ import annotations

import hashlib
import math
import platform
import secrets
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from vsr2.blind.custodian.campaign_recording import RECORDING, recorded_campaign
from vsr2.blind.custodian.design import (
    Protocol,
    catalogue,
    draw_inputs,
    draw_protocol,
    overturning_acceleration,
)
from vsr2.blind.custodian.detection_limit import RULES
from vsr2.blind.custodian.engine import PackEngine, build_engine
from vsr2.blind.custodian.measurements import Measurements
from vsr2.blind.custodian.pack_constants import pack_constants
from vsr2.blind.custodian.pack_streams import PackStream, pack_generator
from vsr2.blind.custodian.plan import (
    Drawn,
    Limits,
    Planned,
    apart,
    check_hidden,
    draw_plan,
    left_out_with,
    not_drawn,
)
from vsr2.blind.custodian.steps import ENTRY, PackState, Steps, numbers, read_back
from vsr2.blind.form.events import EventCode, Say, unheard
from vsr2.blind.form.pack_form import EffectAxis, tiers_made
from vsr2.blind.form.pack_settings import Kind, PackSettings
from vsr2.blind.form.reader import parsed
from vsr2.blind.form.seal import (
    KEY_FILE,
    KEY_SCHEMA,
    PACK_FILE,
    PACK_SCHEMA,
    SALT_BYTES,
    canonical,
    commitment,
    folder_around,
    folder_sha256,
    make_folder,
    open_key,
    read_json,
    set_time_stamps,
    write_json,
)
from vsr2.blind.mujoco import ContactModel, Drawable, Response, draw_contact
from vsr2.campaign import save_campaign
from vsr2.codes import Statement
from vsr2.config import Study
from vsr2.config.motion_source import Filter
from vsr2.config.seeds import checked_seed
from vsr2.config.yaml_file import dump_yaml
from vsr2.errors import BlindError, SimulationError
from vsr2.near_words import offer

SCENE_FILE = "scene.yaml"
FORM = 8
"""Of the data, of what is drawn and of the steps kept; a pack of another form is not continued."""
_STATE = "custodian.json"
_STEPS = "steps.json"


@dataclass(frozen=True)
class MakingConstants:
    """How a campaign is made; chosen by hand, sealed with a pack.

    Attributes:
        placements: draws of a campaign, until its rock rests before every motion.
        least_tilt: that counts where tilts are compared [rad]: less is no response.
    """

    placements: int = 6
    least_tilt: float = 1e-3


MAKING = MakingConstants()


@dataclass(frozen=True)
class Made:
    """A finished pack.

    Attributes:
        campaigns: number of them.
        commitment: SHA-256 that is published with the data.
        not_drawn: by engine, effects of which no magnitude was found from 0.5 to 6 detection
            limits, or the sides of their null (`table_gain below 0`) where there is one on the
            other.
        refused: by engine and effect, for how many campaigns every draw of it was measured outside
            0.5 to 6 detection limits, so that they got another effect, or were not made where each
            effect is left out in turn.
    """

    campaigns: int
    commitment: str
    not_drawn: dict[str, list[str]]
    refused: dict[str, dict[str, int]]


def make_pack(
    study: Study,
    pack: Path,
    key: Path,
    settings: PackSettings,
    *,
    seed: int | None = None,
    say: Say = unheard,
) -> Made:
    """Make a pack, or continue one that was interrupted.

    `pack/data` gets the campaigns under random ids, the scene, and last of all `pack.json` with
    the hash of salt and key; `key` gets the answer and is readable by its owner alone. What
    is drawn depends on the seed, the settings and the scene alone, so that a pack that was killed
    and continued is the same, bit for bit, as one that was not.

    Args:
        study: the nominal scene: rock, contact; its motion is not used.
        pack: folder of the pack.
        key: another folder, not within `pack/data`.
        settings: of the pack.
        seed: of everything; None: from the operating system, kept in the key folder.
        say: gets an event now and then.

    Raises:
        BlindError: the folders hold another pack, lie within each other or cannot be made, the seed
            is negative, or an engine cannot simulate the scene.
        ConfigError: the scene's time step is still to be chosen.
    """
    data = pack / "data"
    _check_asked(pack, data, key, seed)
    study.engine.check_time_step()
    engines = {name: build_engine(name, study) for name in settings.engines}
    effects = _allowed(engines, settings)
    state = _begin(study, data, key, settings, seed)
    _prepare(study, settings, data, key)
    number = int(state["seed"])
    engines, contact = _drawn_engines(study, settings, number)
    motions = catalogue(number, settings.catalogue)
    steps = Steps(key / _STEPS)

    def amplitudes() -> list[float]:
        say(Statement.of(EventCode.AMPLITUDES, engine=settings.engines[0], motions=len(motions)))
        return [
            overturning_acceleration(engines[settings.engines[0]], motion) for motion in motions
        ]

    thresholds = steps.once("overturning_acceleration", amplitudes, numbers(len(motions)))
    protocols = [
        draw_protocol(pack_generator(number, PackStream.PROTOCOL, i), motions, thresholds, settings)
        for i in range(settings.protocols)
    ]
    measured = Measurements(steps, engines, protocols, settings, number, say)
    limits = _limits(effects, measured)
    plan = draw_plan(number, settings, effects, limits, measured.relative)
    entries = {}
    for done, planned in enumerate(plan.campaigns, 1):

        def simulated(planned: Planned = planned, done: int = done) -> dict[str, Any]:
            say(Statement.of(EventCode.CAMPAIGN, number=done, of=len(plan.campaigns)))
            engine, protocol = engines[planned.engine], protocols[planned.protocol]
            return _campaign(data, planned, engine, protocol, settings, number)

        label = f"campaign {planned.id}"
        gone = not (data / planned.id).is_dir()
        entries[planned.id] = steps.once(label, simulated, ENTRY, again=gone)
    if (data / PACK_FILE).exists():
        # Its hash may be published: it stays, whatever versions run now.
        open_key(data, key)
        sealed = str(read_json(data / PACK_FILE)["commitment"]["sha256"])
    else:
        _write_together(data, [*motion_folders(settings), *sorted(entries)])
        sealed = _seal(data, key, state, settings, engines, limits, entries, contact)
    set_time_stamps(data)
    return Made(
        len(entries),
        sealed,
        {name: not_drawn(effects, limits, name) for name in effects},
        {name: dict(sorted(plan.refused.get(name, {}).items())) for name in effects},
    )


def _check_asked(pack: Path, data: Path, key: Path, seed: int | None) -> None:
    """Refuse folders within each other or within another pack, and what is no seed."""
    if seed is not None:
        checked_seed(seed, BlindError)
    if key.resolve().is_relative_to(data.resolve()) or data.resolve().is_relative_to(key.resolve()):
        raise BlindError(f"{key}: lies within the data (or they in it); keep the key apart")
    for folder in (pack, key):
        other = folder_around(folder, PACK_FILE)
        if other is not None:
            raise BlindError(
                f"{folder}: {other} holds a {PACK_FILE}, so that it is the data folder of a pack, "
                "which may not change; choose a folder outside it"
            )


def _allowed(
    engines: Mapping[str, PackEngine], settings: PackSettings
) -> dict[str, dict[str, Drawable]]:
    """The effects that may be drawn, by engine and name."""
    out = {}
    for name, engine in engines.items():
        if not settings.asks(name):
            continue
        unknown = set(settings.effects) - set(engine.effects)
        if unknown:
            wrong = min(unknown)
            raise BlindError(
                f"engine {name} has no effect {wrong!r}; {offer(wrong, list(engine.effects))}"
            )
        allowed = settings.effects or engine.effects
        out[name] = {one: effect for one, effect in engine.effects.items() if one in allowed}
    if out:
        common = set.intersection(*({settings.class_of(one) for one in of} for of in out.values()))
        if not settings.leave_one_out:
            # Those for which least is left out first, so that there are most of them.
            smallest = sorted(common, key=lambda one: (len(left_out_with(one, settings)), one))
            common = set(apart(smallest, settings))
        most = len(common)
        check_hidden(settings, most if settings.leave_one_out else min(settings.hidden, most))
    return out


def _drawn_engines(
    study: Study, settings: PackSettings, seed: int
) -> tuple[dict[str, PackEngine], ContactModel]:
    """The engines of a pack, with a contact model that no other pack of the other kind has."""
    rng = pack_generator(seed, PackStream.CONTACT)
    contact = draw_contact(rng, development=settings.development)
    return {name: build_engine(name, study, contact) for name in settings.engines}, contact


def _limits(
    effects: Mapping[str, Mapping[str, Drawable]], measured: Measurements
) -> dict[tuple[str, str, int], float]:
    """Detection limits by engine, effect and sign.

    A search begins at the limit that an engine before it has; name a quick engine first.
    """
    out: dict[tuple[str, str, int], float] = {}
    for engine, known in effects.items():
        for name, effect in known.items():
            for sign in effect.strength.reach():
                near = min(
                    (v for (_, *key), v in out.items() if key == [name, sign]), default=math.inf
                )
                out[engine, name, sign] = measured.limit(engine, effect, sign, near)
    return out


def _begin(
    study: Study, data: Path, key: Path, settings: PackSettings, seed: int | None
) -> dict[str, Any]:
    """The custodian's state: read where the pack was begun, else drawn and written."""
    asked: dict[str, Any] = {
        "form": FORM,
        # Through JSON, so that tuples compare as the lists that a file holds.
        "settings": read_back(settings.to_json()),
        "scene_sha256": hashlib.sha256(canonical(_scene(study, settings))).hexdigest(),
    }
    file = getattr(study.rock, "file", None)
    if file is not None:
        asked["model_sha256"] = hashlib.sha256(Path(file).read_bytes()).hexdigest()
    path = key / _STATE
    if path.exists():
        state = read_json(path)
        settled = state.get("settings")
        before = state | (settled if isinstance(settled, dict) else {})
        now = {**asked, **asked["settings"]}
        differs = [name for name in now if name != "settings" and before.get(name) != now[name]]
        if seed is not None and state.get("seed") != str(seed):
            differs.append("seed")
        if differs:
            raise BlindError(
                f"{path}: was begun with another {', '.join(differs)}; continue it with the same, "
                "or choose other folders"
            )
        parsed(PackState, state, str(path))
        if (data / PACK_FILE).exists() and not (key / KEY_FILE).exists():
            raise BlindError(f"{key}: the pack is finished but {KEY_FILE} is gone")
        return state
    for folder in (data, key):
        # What a killed writer leaves of the state itself is no other pack.
        if folder.is_dir() and set(folder.iterdir()) - set(folder.glob(f".{_STATE}.*.tmp")):
            raise BlindError(
                f"{folder}: is not empty and holds no pack of this key; choose another"
            )
    for folder in (data, key):
        make_folder(folder)
    key.chmod(0o700)
    salt = hashlib.sha256(f"salt {seed}".encode()).hexdigest()
    state = asked | {
        "seed": str(secrets.randbits(63) if seed is None else seed),
        "salt": secrets.token_hex(SALT_BYTES) if seed is None else salt,
    }
    write_json(path, state, private=True)
    return state


def is_begun(key: Path) -> bool:
    """Whether a folder holds the key of a pack, begun or finished."""
    return (key / _STATE).exists()


def motion_folders(settings: PackSettings) -> list[str]:
    """Of the motions that campaigns share, one a protocol, in the data folder."""
    count = settings.protocols
    return ["motions"] if count == 1 else [f"motions{i + 1}" for i in range(count)]


def _scene(study: Study, settings: PackSettings) -> dict[str, Any]:
    """The nominal scene as plain data, driven by the recorded motions, whose noise is filtered."""
    content = study.model_dump(mode="json", exclude_unset=True)
    content["name"] = "blind"
    content["motion"] = {
        "mode": "all_recordings",
        "folder": motion_folders(settings)[0],
        "filter": Filter().model_dump(),
    }
    content.pop("output", None)
    if "file" in content["rock"]:
        content["rock"]["file"] = f"model{Path(content['rock']['file']).suffix.lower()}"
    return content


def _prepare(study: Study, settings: PackSettings, data: Path, key: Path) -> None:
    """Remove what a killed writer left behind, and write the scene of an unfinished pack."""
    data.mkdir(parents=True, exist_ok=True)
    for left in (*data.glob(".*.tmp"), *key.glob(".*.tmp")):
        if left.is_dir():
            shutil.rmtree(left)
        else:
            left.unlink()
    if (data / PACK_FILE).exists():
        return
    (data / SCENE_FILE).write_text(dump_yaml(_scene(study, settings)), encoding="utf-8")
    file = getattr(study.rock, "file", None)
    if file is not None:
        shutil.copyfile(file, data / f"model{Path(file).suffix.lower()}")


def _campaign(
    data: Path,
    planned: Planned,
    engine: PackEngine,
    protocol: Protocol,
    settings: PackSettings,
    seed: int,
) -> dict[str, Any]:
    """Simulate and write one campaign; returns its entry of the key.

    Where a rock does not come to rest, all draws are repeated, as it would be placed again.

    Raises:
        SimulationError: nor does it in any of `MAKING.placements` draws.
    """
    for attempt in range(MAKING.placements):
        rng = pack_generator(
            seed, PackStream.CAMPAIGN, planned.index, *([attempt] if attempt else [])
        )
        gain, inputs = draw_inputs(rng, protocol, settings)
        *seeds, common = (int(one) for one in rng.integers(0, 2**31, size=len(inputs) + 1))
        plain = [
            replace(one, context=replace(one.context, campaign_seed=common, trial_seed=own))
            for one, own in zip(inputs, seeds, strict=True)
        ]
        acting = {effect.name: effect.values for effect in planned.effects}
        weights: list[float] = []
        flips = None
        try:
            shaken = [replace(one, effects=acting) for one in plain]
            seen = list(engine.run(shaken, settings.series_interval or 1.0))
            if acting:
                # The same campaign without the effect, all else equal: where the effect acts.
                nominal = engine.run(plain, 1.0)
                pairs = list(zip(seen, nominal, strict=True))
                weights = [_change(a, b) for a, b in pairs]
                flipped = sum(a.overturned != b.overturned for a, b in pairs)
                flips = round(flipped / len(pairs), 4)
            break
        except SimulationError:
            if attempt == MAKING.placements - 1:
                raise
    campaign = recorded_campaign(planned.id, protocol, seen, settings, rng)
    folder = data / planned.id
    if folder.exists():
        shutil.rmtree(folder)
    motions = motion_folders(settings)[planned.protocol]
    save_campaign(campaign, folder, motions=f"../{motions}")
    set_time_stamps(folder)
    return {
        "kind": planned.kind,
        "engine": planned.engine,
        "effects": [asdict(effect) for effect in planned.effects],
        "exclude": list(planned.exclude),
        "protocol": planned.protocol,
        "nuisances": asdict(inputs[0].nuisances) | {"input_gain": gain},
        "flips": flips,
        "where": {"axis": _axis(planned.effects), "weights": weights},
        "data_sha256": folder_sha256(folder),
    }


def _write_together(data: Path, names: Sequence[str]) -> None:
    """Copy all campaigns, one after the other: a file system may keep when each was made.

    Made as they are simulated, the time between two of them would tell the engine and the kind.
    """
    for name in names:
        fresh = data / f".{name}.tmp"
        shutil.copytree(data / name, fresh)
        shutil.rmtree(data / name)
        fresh.rename(data / name)


def _change(a: Response, b: Response) -> float:
    tilts = [min(max(x.peak_tilt, MAKING.least_tilt), RECORDING.range) for x in (a, b)]
    return round(float(a.overturned != b.overturned) + abs(math.log(tilts[0] / tilts[1])), 4)


def _axis(effects: tuple[Drawn, ...]) -> EffectAxis:
    if not effects:
        return EffectAxis.NONE
    drifts = any(effect.drifts for effect in effects)
    return EffectAxis.ORDER if drifts else EffectAxis.CONDITIONS


def _seal(
    data: Path,
    key: Path,
    state: Mapping[str, Any],
    settings: PackSettings,
    engines: Mapping[str, PackEngine],
    limits: Limits,
    entries: dict[str, Any],
    contact: ContactModel,
) -> str:
    versions = {"numpy": np.__version__, "python": platform.python_version()}
    for engine in engines.values():
        versions |= dict(engine.versions)
    content = read_back(
        {
            "campaigns": entries,
            "settings": settings.to_json(),
            "motions_sha256": {
                name: folder_sha256(data / name) for name in motion_folders(settings)
            },
            "contact": asdict(contact),
            "rules": asdict(RULES),
            "constants": pack_constants(asdict(MAKING)),
            **{name: state[name] for name in ("scene_sha256", "model_sha256") if name in state},
            "seed": state["seed"],
            "versions": versions,
            "detection_limits": {
                f"{engine} {name} {sign:+d}": limit if math.isfinite(limit) else None
                for (engine, name, sign), limit in limits.items()
            },
        }
    )
    sealed = commitment(state["salt"], content)
    write_json(
        key / KEY_FILE,
        {"schema": KEY_SCHEMA, "salt": state["salt"], "key": content},
        private=True,
    )
    published = {
        "schema": PACK_SCHEMA,
        "development": settings.development,
        "scene": SCENE_FILE,
        "tiers": tiers_made(settings.series_interval),
        "classes": settings.classes,
        "tolerances": settings.tolerances.model_dump(),
        "campaigns": [
            {
                "id": name,
                "protocol": entries[name]["protocol"],
                "exclude": entries[name]["exclude"],
                **({"kind": "reference"} if entries[name]["kind"] == Kind.REFERENCE else {}),
            }
            for name in sorted(entries)
        ],
        "commitment": {"algorithm": "sha256(salt + canonical key)", "sha256": sealed},
    }
    write_json(data / PACK_FILE, read_back(published))
    return sealed
