"""
Native core of VSR2.
"""
from __future__ import annotations
import enum
import numpy
import numpy.typing
import typing
__all__: list[str] = ['Batch', 'BoxPart', 'Column', 'ContactParameter', 'ContactValues', 'Drive', 'EngineKind', 'EngineMode', 'EngineSettings', 'FastRefusal', 'Fault', 'HandOver', 'HullPart', 'InvalidInput', 'Mechanisms', 'Outcome', 'PedestalSpec', 'PitchSpring', 'RockSpec', 'Samples', 'Scene', 'SettledStart', 'Status', 'TrialResult', 'TrialSpec', 'TrianglesPart', 'World', 'WorldState', 'build_facts', 'combine', 'contact_columns', 'contact_parameters', 'core_constants', 'excursion_columns', 'follow_within_limits', 'result_columns', 'state_columns']
class InvalidInput(ValueError):
    pass
class Fault(enum.StrEnum):
    acts_already: typing.ClassVar[Fault]
    bad_value: typing.ClassVar[Fault]
    drive: typing.ClassVar[Fault]
    engine_domain: typing.ClassVar[Fault]
    geometry: typing.ClassVar[Fault]
    motion: typing.ClassVar[Fault]
    no_rock: typing.ClassVar[Fault]
    rock_present: typing.ClassVar[Fault]
class ContactValues:
    def __init__(self, *, restitution: float, lateral_friction: float, spinning_friction: float, rolling_friction: float, stiffness: float, damping: float) -> None:
        ...
    @property
    def damping(self) -> float:
        """
        N s/m
        """
    @property
    def lateral_friction(self) -> float:
        ...
    @property
    def restitution(self) -> float:
        ...
    @property
    def rolling_friction(self) -> float:
        """
        m
        """
    @property
    def spinning_friction(self) -> float:
        """
        m
        """
    @property
    def stiffness(self) -> float:
        """
        N/m
        """
class ContactParameter:
    """
    What a contact parameter may be, and is where nothing is given.
    """
    @property
    def above(self) -> bool:
        """
        Whether the least is left out.
        """
    @property
    def fast(self) -> bool:
        """
        Whether the engine `fast` has it; without, it takes 0 alone.
        """
    @property
    def greatest(self) -> float:
        ...
    @property
    def least(self) -> float:
        ...
    @property
    def name(self) -> str:
        ...
    @property
    def original(self) -> float:
        """
        Value of the original system.
        """
    @property
    def unit(self) -> str:
        """
        Empty: none.
        """
    @property
    def usual(self) -> float:
        """
        Value of a study that gives none.
        """
class EngineKind(enum.StrEnum):
    auto: typing.ClassVar[EngineKind]
    exact: typing.ClassVar[EngineKind]
    fast: typing.ClassVar[EngineKind]
    parity: typing.ClassVar[EngineKind]
class HandOver(enum.StrEnum):
    motor_on_a_slope: typing.ClassVar[HandOver]
    none: typing.ClassVar[HandOver]
    off_the_top: typing.ClassVar[HandOver]
    too_deep: typing.ClassVar[HandOver]
class FastRefusal(enum.StrEnum):
    contact_parameter: typing.ClassVar[FastRefusal]
    no_friction_cone: typing.ClassVar[FastRefusal]
    no_margin: typing.ClassVar[FastRefusal]
    none: typing.ClassVar[FastRefusal]
    pedestal_not_a_box: typing.ClassVar[FastRefusal]
    several_parts: typing.ClassVar[FastRefusal]
class EngineSettings:
    def __init__(self, *, kind: EngineKind, gravity: float, time_step: float, substeps: int, solver_iterations: int, residual_threshold: float, converged_contacts: bool, skip_quiet: bool, restitution_velocity_threshold: float, cone_friction: bool, deterministic_overlapping_pairs: bool, collision_margin: float, contact_breaking_threshold: float, linear_damping: float, angular_damping: float) -> None:
        ...
class HullPart:
    def __init__(self, *, points: numpy.ndarray) -> None:
        ...
class BoxPart:
    def __init__(self, *, size: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"], position: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"], orientation: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[4]"]) -> None:
        ...
class TrianglesPart:
    def __init__(self, *, vertices: numpy.ndarray, faces: numpy.ndarray) -> None:
        ...
class PitchSpring:
    def __init__(self, *, frequency: float, damping: float, compliance: float, inertia: float) -> None:
        ...
class PedestalSpec:
    def __init__(self, *, parts: list[HullPart | BoxPart | TrianglesPart], origin: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"], mass: float, base_size: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"], top: float, material: ContactValues, pitch_pivot: float, pitch_spring: PitchSpring | None) -> None:
        ...
class RockSpec:
    def __init__(self, *, parts: list[HullPart | BoxPart | TrianglesPart], mass: float, principal_inertia: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"], inertia_from_aabb: bool, mass_center: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"], principal_axes: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[4]"], material: ContactValues) -> None:
        ...
class Mechanisms:
    def __init__(self, *, impact_energy_ratio: float, rocking_damping: float, rolling_resistance: float, friction_ratio: float, friction_speed: float, adhesion: float, catch_slack: float) -> None:
        ...
class Scene:
    def __init__(self, *, engine: EngineSettings, pedestal: PedestalSpec, rock: RockSpec, mechanisms: Mechanisms) -> None:
        ...
    @property
    def engine(self) -> EngineKind:
        """
        Engine the scene gets.
        """
    @property
    def fast_refusal(self) -> FastRefusal:
        """
        Why the engine `fast` does not take the scene.
        """
    @property
    def rock_hull_vertices(self) -> numpy.typing.NDArray[numpy.float64]:
        ...
    @property
    def rock_inertia(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"]:
        ...
class Drive(enum.StrEnum):
    motor_position: typing.ClassVar[Drive]
    motor_position_velocity: typing.ClassVar[Drive]
    prescribed: typing.ClassVar[Drive]
    prescribed_spatial: typing.ClassVar[Drive]
class WorldState:
    """
    State of a world, opaque; pickles and copies.
    """
    def __getstate__(self) -> tuple[Drive, bytes]:
        ...
    def __setstate__(self, arg0: tuple) -> None:
        ...
class World:
    def __init__(self, *, scene: Scene, drive: Drive) -> None:
        ...
    def contacts(self) -> list:
        ...
    def delete_rock(self) -> None:
        ...
    def restore_state(self, state: WorldState) -> None:
        ...
    def save_state(self) -> WorldState:
        ...
    def set_rock_velocity(self, *, linear: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"], angular: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"]) -> None:
        ...
    def settle(self, *, linear_speed: typing.SupportsFloat | typing.SupportsIndex, angular_speed: typing.SupportsFloat | typing.SupportsIndex, window: typing.SupportsFloat | typing.SupportsIndex, timeout: typing.SupportsFloat | typing.SupportsIndex) -> tuple[int, bool]:
        """
        Holds the pedestal until the rock rests: steps taken, and whether it rests.
        """
    def spawn_rock(self, *, position: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"], orientation: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[4]"]) -> None:
        ...
    def step(self, *, position: typing.SupportsFloat | typing.SupportsIndex, velocity: typing.SupportsFloat | typing.SupportsIndex, transverse: typing.SupportsFloat | typing.SupportsIndex = 0.0, vertical: typing.SupportsFloat | typing.SupportsIndex = 0.0, pitch: typing.SupportsFloat | typing.SupportsIndex = 0.0) -> None:
        ...
    @property
    def engine(self) -> EngineKind:
        """
        Engine it was built with.
        """
    @property
    def excursion(self) -> tuple[float, float, float]:
        """
        Columns excursion_columns().
        """
    @property
    def hand_over(self) -> HandOver:
        """
        Why `fast` went on with `exact`, if it did.
        """
    @property
    def has_rock(self) -> bool:
        ...
    @property
    def pedestal(self) -> tuple[float, float]:
        ...
    @property
    def rock(self) -> tuple[typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"], typing.Annotated[numpy.typing.NDArray[numpy.float64], "[4, 1]"], typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"], typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"]]:
        ...
class Status(enum.StrEnum):
    cancelled: typing.ClassVar[Status]
    diverged: typing.ClassVar[Status]
    error: typing.ClassVar[Status]
    not_run: typing.ClassVar[Status]
    ok: typing.ClassVar[Status]
    settling_timeout: typing.ClassVar[Status]
    tail_timeout: typing.ClassVar[Status]
class Outcome(enum.StrEnum):
    failed: typing.ClassVar[Outcome]
    overturned: typing.ClassVar[Outcome]
    rocked: typing.ClassVar[Outcome]
    rotated: typing.ClassVar[Outcome]
    slid: typing.ClassVar[Outcome]
    stable: typing.ClassVar[Outcome]
class Samples:
    """
    Set-points in the memory of a read-only array, which it keeps.
    """
    def __init__(self, *, values: numpy.ndarray) -> None:
        ...
class SettledStart:
    def __init__(self, *, scene: Scene, drive: Drive, position: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3]"], orientation: typing.Annotated[numpy.typing.NDArray[numpy.float64], "[4]"], linear_speed: float, angular_speed: float, window: float, timeout: float, log_every: int) -> None:
        ...
class TrialSpec:
    def __init__(self, *, start: SettledStart, motion_position: Samples, motion_velocity: Samples | None, transverse: Samples | None, vertical: Samples | None, pitch: Samples | None, tail: float, rest_linear_speed: float, rest_angular_speed: float, rest_window: float, overturned_tilt: float, toppled_tilt: float, rocked_tilt: float, slid_distance: float, rotated_angle: float, stop_early: bool, log_every: int, contacts_every: int) -> None:
        ...
class TrialResult:
    """
    Its numbers: result_columns().
    """
    def take_contacts(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Contact log, columns contact_columns(); may be taken once.
        """
    def take_excursions(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Columns excursion_columns(): one row a row of the state log, or none where the pedestal moved along x; may be taken once.
        """
    def take_log(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        State log, columns state_columns(); may be taken once.
        """
    @property
    def engine(self) -> EngineKind | None:
        """
        That started it; None where none did.
        """
    @property
    def final_slip(self) -> float:
        """
        m
        """
    @property
    def final_tilt(self) -> float:
        """
        rad
        """
    @property
    def final_yaw(self) -> float:
        """
        rad
        """
    @property
    def foot(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"]:
        ...
    @property
    def hand_over(self) -> HandOver:
        """
        Why `fast` went on with `exact`.
        """
    @property
    def message(self) -> str:
        ...
    @property
    def outcome(self) -> Outcome:
        ...
    @property
    def overturning_time(self) -> float:
        """
        s
        """
    @property
    def peak_tilt(self) -> float:
        """
        rad
        """
    @property
    def peak_tracking_error(self) -> float:
        """
        m
        """
    @property
    def settled_orientation(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[4, 1]"]:
        ...
    @property
    def settled_position(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"]:
        ...
    @property
    def settling_time(self) -> float:
        """
        s
        """
    @property
    def simulated_time(self) -> float:
        """
        s
        """
    @property
    def status(self) -> Status:
        ...
    @property
    def steps(self) -> int:
        ...
class Batch:
    def __init__(self, *, threads: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def add(self, trial: TrialSpec) -> int:
        ...
    def cancel(self) -> None:
        ...
    def close(self) -> None:
        ...
    def exhausted(self) -> bool:
        ...
    def join(self) -> None:
        ...
    def take(self, index: typing.SupportsInt | typing.SupportsIndex) -> TrialResult:
        ...
    def wait(self, timeout: typing.SupportsFloat | typing.SupportsIndex) -> list[int]:
        ...
class Column:
    def __init__(self, *, name: str, unit: str, description: str, missing: str, dtype: str) -> None:
        ...
    @property
    def description(self) -> str:
        """
        Without the unit.
        """
    @property
    def dtype(self) -> str:
        """
        That numpy holds it with; text is of dtype object.
        """
    @property
    def missing(self) -> str:
        """
        What NaN or an empty text says; empty: nothing.
        """
    @property
    def name(self) -> str:
        ...
    @property
    def quantity(self) -> str:
        """
        Description without the component, of a column of a log.
        """
    @property
    def unit(self) -> str:
        """
        1: a number without one; empty: no number.
        """
    @property
    def vector(self) -> str:
        """
        Of which it is a component; empty: of none.
        """
def build_facts() -> dict[str, str]:
    ...
def combine(*, a: ContactValues, b: ContactValues) -> ContactValues:
    ...
def contact_columns() -> list[Column]:
    ...
def contact_parameters() -> list[ContactParameter]:
    ...
def core_constants() -> dict[str, dict[str, float | int]]:
    """
    Chosen numbers of the core, by what they are of and by name.
    """
def excursion_columns() -> list[Column]:
    ...
def follow_within_limits(*, command: typing.Any, place: typing.SupportsFloat | typing.SupportsIndex, speed: typing.SupportsFloat | typing.SupportsIndex, greatest_speed: typing.SupportsFloat | typing.SupportsIndex, greatest_acceleration: typing.SupportsFloat | typing.SupportsIndex, stiffness: typing.SupportsFloat | typing.SupportsIndex, damping: typing.SupportsFloat | typing.SupportsIndex, time_step: typing.SupportsFloat | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.float64]:
    """
    Displacement, velocity and acceleration of a table with limits that follows a command, shape (3, n).
    """
def result_columns() -> list[Column]:
    """
    What running a trial gives in its row.
    """
def state_columns() -> list[Column]:
    ...
EngineMode = typing.Literal['auto', 'parity', 'exact', 'fast']
