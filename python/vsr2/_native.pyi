"""
Native core of VSR2.
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import typing
__all__: list[str] = ['Batch', 'BoxPart', 'CONTACT_COLUMNS', 'ContactPair', 'Drive', 'EngineKind', 'EngineSettings', 'HullPart', 'InvalidInput', 'LOG_COLUMNS', 'Material', 'Mechanisms', 'Outcome', 'PedestalSpec', 'PitchSpring', 'RockSpec', 'Samples', 'Scene', 'SettledStart', 'Status', 'TrialResult', 'TrialSpec', 'TrianglesPart', 'World', 'build_facts', 'combine', 'contact_softness', 'diagonalise_inertia', 'inverse_mass_along', 'normal_impulse', 'restitution_target']
class InvalidInput(ValueError):
    pass
class Material:
    def __init__(self, *, restitution: typing.SupportsFloat | typing.SupportsIndex, lateral_friction: typing.SupportsFloat | typing.SupportsIndex, spinning_friction: typing.SupportsFloat | typing.SupportsIndex, rolling_friction: typing.SupportsFloat | typing.SupportsIndex, stiffness: typing.SupportsFloat | typing.SupportsIndex, damping: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
class EngineKind:
    """
    Members:
    
      auto
    
      parity
    
      exact
    
      fast
    """
    __members__: typing.ClassVar[dict[str, EngineKind]]
    auto: typing.ClassVar[EngineKind]
    exact: typing.ClassVar[EngineKind]
    fast: typing.ClassVar[EngineKind]
    parity: typing.ClassVar[EngineKind]
    @typing.overload
    def __eq__(self, other: EngineKind) -> bool:
        ...
    @typing.overload
    def __eq__(self, other: typing.Any) -> bool:
        ...
    def __getstate__(self) -> int:
        ...
    def __hash__(self) -> int:
        ...
    def __index__(self) -> int:
        ...
    def __init__(self, value: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __int__(self) -> int:
        ...
    @typing.overload
    def __ne__(self, other: EngineKind) -> bool:
        ...
    @typing.overload
    def __ne__(self, other: typing.Any) -> bool:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, state: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __str__(self) -> str:
        ...
    @property
    def name(self) -> str:
        ...
    @property
    def value(self) -> int:
        ...
class EngineSettings:
    def __init__(self, *, kind: EngineKind, gravity: typing.SupportsFloat | typing.SupportsIndex, time_step: typing.SupportsFloat | typing.SupportsIndex, substeps: typing.SupportsInt | typing.SupportsIndex, solver_iterations: typing.SupportsInt | typing.SupportsIndex, residual_threshold: typing.SupportsFloat | typing.SupportsIndex, restitution_velocity_threshold: typing.SupportsFloat | typing.SupportsIndex, cone_friction: bool, deterministic_overlapping_pairs: bool, collision_margin: typing.SupportsFloat | typing.SupportsIndex, contact_breaking_threshold: typing.SupportsFloat | typing.SupportsIndex, linear_damping: typing.SupportsFloat | typing.SupportsIndex, angular_damping: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
class HullPart:
    def __init__(self, points: typing.Annotated[numpy.typing.ArrayLike, numpy.float64]) -> None:
        ...
class BoxPart:
    def __init__(self, size: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], position: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], orientation: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[4, 1]"]) -> None:
        ...
class TrianglesPart:
    def __init__(self, vertices: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], faces: typing.Annotated[numpy.typing.ArrayLike, numpy.int32]) -> None:
        ...
class PitchSpring:
    def __init__(self, *, frequency: typing.SupportsFloat | typing.SupportsIndex, damping: typing.SupportsFloat | typing.SupportsIndex, compliance: typing.SupportsFloat | typing.SupportsIndex, inertia: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
class PedestalSpec:
    def __init__(self, *, parts: collections.abc.Sequence[HullPart | BoxPart | TrianglesPart], origin: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], mass: typing.SupportsFloat | typing.SupportsIndex, base_size: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], top: typing.SupportsFloat | typing.SupportsIndex, material: Material, pitch_pivot: typing.SupportsFloat | typing.SupportsIndex, pitch_spring: PitchSpring | None = None) -> None:
        ...
class RockSpec:
    def __init__(self, *, parts: collections.abc.Sequence[HullPart | BoxPart | TrianglesPart], mass: typing.SupportsFloat | typing.SupportsIndex, principal_inertia: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], inertia_from_aabb: bool, mass_center: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], principal_axes: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[4, 1]"], material: Material) -> None:
        ...
class Mechanisms:
    def __init__(self, *, impact_energy_ratio: typing.SupportsFloat | typing.SupportsIndex, rocking_damping: typing.SupportsFloat | typing.SupportsIndex, rolling_resistance: typing.SupportsFloat | typing.SupportsIndex, friction_ratio: typing.SupportsFloat | typing.SupportsIndex, friction_speed: typing.SupportsFloat | typing.SupportsIndex, adhesion: typing.SupportsFloat | typing.SupportsIndex, catch_slack: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
class Scene:
    def __init__(self, *, engine: EngineSettings, pedestal: PedestalSpec, rock: RockSpec, mechanisms: Mechanisms) -> None:
        ...
    @property
    def engine(self) -> str:
        """
        Engine the scene gets.
        """
    @property
    def fast_domain_violation(self) -> str:
        """
        Why the engine `fast` does not take the scene; empty if it does.
        """
    @property
    def rock_hull_vertices(self) -> numpy.typing.NDArray[numpy.float64]:
        ...
    @property
    def rock_inertia(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"]:
        ...
class Drive:
    """
    Members:
    
      prescribed
    
      prescribed_spatial
    
      motor_position
    
      motor_position_velocity
    """
    __members__: typing.ClassVar[dict[str, Drive]]
    motor_position: typing.ClassVar[Drive]
    motor_position_velocity: typing.ClassVar[Drive]
    prescribed: typing.ClassVar[Drive]
    prescribed_spatial: typing.ClassVar[Drive]
    @typing.overload
    def __eq__(self, other: Drive) -> bool:
        ...
    @typing.overload
    def __eq__(self, other: typing.Any) -> bool:
        ...
    def __getstate__(self) -> int:
        ...
    def __hash__(self) -> int:
        ...
    def __index__(self) -> int:
        ...
    def __init__(self, value: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __int__(self) -> int:
        ...
    @typing.overload
    def __ne__(self, other: Drive) -> bool:
        ...
    @typing.overload
    def __ne__(self, other: typing.Any) -> bool:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, state: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __str__(self) -> str:
        ...
    @property
    def name(self) -> str:
        ...
    @property
    def value(self) -> int:
        ...
class World:
    def __init__(self, scene: Scene, drive: Drive) -> None:
        ...
    def contacts(self) -> list:
        ...
    def delete_rock(self) -> None:
        ...
    def engine(self, scene: Scene) -> str:
        ...
    def set_rock_velocity(self, linear: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], angular: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"]) -> None:
        ...
    def spawn_rock(self, position: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], orientation: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[4, 1]"]) -> None:
        ...
    def step(self, position: typing.SupportsFloat | typing.SupportsIndex, velocity: typing.SupportsFloat | typing.SupportsIndex, transverse: typing.SupportsFloat | typing.SupportsIndex = 0.0, vertical: typing.SupportsFloat | typing.SupportsIndex = 0.0, pitch: typing.SupportsFloat | typing.SupportsIndex = 0.0) -> None:
        ...
    @property
    def excursion(self) -> tuple[float, float, float]:
        """
        Transverse and vertical displacement [m], pitch [rad].
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
class Status:
    """
    Members:
    
      ok
    
      settling_timeout
    
      tail_timeout
    
      diverged
    
      error
    
      cancelled
    
      not_run
    """
    __members__: typing.ClassVar[dict[str, Status]]
    cancelled: typing.ClassVar[Status]
    diverged: typing.ClassVar[Status]
    error: typing.ClassVar[Status]
    not_run: typing.ClassVar[Status]
    ok: typing.ClassVar[Status]
    settling_timeout: typing.ClassVar[Status]
    tail_timeout: typing.ClassVar[Status]
    @typing.overload
    def __eq__(self, other: Status) -> bool:
        ...
    @typing.overload
    def __eq__(self, other: typing.Any) -> bool:
        ...
    def __getstate__(self) -> int:
        ...
    def __hash__(self) -> int:
        ...
    def __index__(self) -> int:
        ...
    def __init__(self, value: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __int__(self) -> int:
        ...
    @typing.overload
    def __ne__(self, other: Status) -> bool:
        ...
    @typing.overload
    def __ne__(self, other: typing.Any) -> bool:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, state: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __str__(self) -> str:
        ...
    @property
    def name(self) -> str:
        ...
    @property
    def value(self) -> int:
        ...
class Outcome:
    """
    Members:
    
      stable
    
      rocked
    
      slid
    
      rotated
    
      overturned
    
      failed
    """
    __members__: typing.ClassVar[dict[str, Outcome]]
    failed: typing.ClassVar[Outcome]
    overturned: typing.ClassVar[Outcome]
    rocked: typing.ClassVar[Outcome]
    rotated: typing.ClassVar[Outcome]
    slid: typing.ClassVar[Outcome]
    stable: typing.ClassVar[Outcome]
    @typing.overload
    def __eq__(self, other: Outcome) -> bool:
        ...
    @typing.overload
    def __eq__(self, other: typing.Any) -> bool:
        ...
    def __getstate__(self) -> int:
        ...
    def __hash__(self) -> int:
        ...
    def __index__(self) -> int:
        ...
    def __init__(self, value: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __int__(self) -> int:
        ...
    @typing.overload
    def __ne__(self, other: Outcome) -> bool:
        ...
    @typing.overload
    def __ne__(self, other: typing.Any) -> bool:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, state: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    def __str__(self) -> str:
        ...
    @property
    def name(self) -> str:
        ...
    @property
    def value(self) -> int:
        ...
class Samples:
    def __init__(self, values: typing.Annotated[numpy.typing.ArrayLike, numpy.float64]) -> None:
        ...
class SettledStart:
    def __init__(self, *, scene: Scene, drive: Drive, position: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], orientation: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[4, 1]"], linear_speed: typing.SupportsFloat | typing.SupportsIndex, angular_speed: typing.SupportsFloat | typing.SupportsIndex, window: typing.SupportsFloat | typing.SupportsIndex, timeout: typing.SupportsFloat | typing.SupportsIndex, log_every: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
class TrialSpec:
    def __init__(self, *, start: SettledStart, motion_position: Samples, motion_velocity: Samples | None, transverse: Samples | None, vertical: Samples | None, pitch: Samples | None, tail: typing.SupportsFloat | typing.SupportsIndex, rest_linear_speed: typing.SupportsFloat | typing.SupportsIndex, rest_angular_speed: typing.SupportsFloat | typing.SupportsIndex, rest_window: typing.SupportsFloat | typing.SupportsIndex, overturned_tilt: typing.SupportsFloat | typing.SupportsIndex, toppled_tilt: typing.SupportsFloat | typing.SupportsIndex, rocked_tilt: typing.SupportsFloat | typing.SupportsIndex, slid_distance: typing.SupportsFloat | typing.SupportsIndex, rotated_angle: typing.SupportsFloat | typing.SupportsIndex, stop_early: bool, log_every: typing.SupportsInt | typing.SupportsIndex, contacts_every: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
class TrialResult:
    def take_contacts(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Contact log, shape (n, 20); may be taken once.
        """
    def take_excursions(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        Transverse, vertical and pitch of the pedestal, one row a row of the state log, or none where it moved along x; may be taken once.
        """
    def take_log(self) -> numpy.typing.NDArray[numpy.float64]:
        """
        State log, shape (n, 18); may be taken once.
        """
    @property
    def engine(self) -> str:
        ...
    @property
    def final_slip(self) -> float:
        ...
    @property
    def final_tilt(self) -> float:
        ...
    @property
    def final_yaw(self) -> float:
        ...
    @property
    def foot(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"]:
        ...
    @property
    def message(self) -> str:
        ...
    @property
    def outcome(self) -> Outcome:
        ...
    @property
    def overturning_time(self) -> float:
        ...
    @property
    def peak_tilt(self) -> float:
        ...
    @property
    def peak_tracking_error(self) -> float:
        ...
    @property
    def settled_orientation(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[4, 1]"]:
        ...
    @property
    def settled_position(self) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"]:
        ...
    @property
    def settling_time(self) -> float:
        ...
    @property
    def simulated_time(self) -> float:
        ...
    @property
    def status(self) -> Status:
        ...
    @property
    def steps(self) -> int:
        ...
class Batch:
    def __init__(self, threads: typing.SupportsInt | typing.SupportsIndex) -> None:
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
class ContactPair:
    @property
    def damping(self) -> float:
        ...
    @property
    def lateral_friction(self) -> float:
        ...
    @property
    def restitution(self) -> float:
        ...
    @property
    def spinning_friction(self) -> float:
        ...
    @property
    def stiffness(self) -> float:
        ...
def build_facts() -> dict[str, str]:
    ...
def combine(a: Material, b: Material) -> ContactPair:
    ...
def contact_softness(stiffness: typing.SupportsFloat | typing.SupportsIndex, damping: typing.SupportsFloat | typing.SupportsIndex, time_step: typing.SupportsFloat | typing.SupportsIndex) -> tuple[float, float]:
    ...
def diagonalise_inertia(tensor: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 3]"]) -> tuple[typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 3]"], typing.Annotated[numpy.typing.NDArray[numpy.float64], "[3, 1]"]]:
    ...
def inverse_mass_along(normal: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], inverse_mass_a: typing.SupportsFloat | typing.SupportsIndex, inverse_inertia_a: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 3]"], r_a: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"], inverse_mass_b: typing.SupportsFloat | typing.SupportsIndex, inverse_inertia_b: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 3]"], r_b: typing.Annotated[numpy.typing.ArrayLike, numpy.float64, "[3, 1]"]) -> float:
    ...
def normal_impulse(rebound_target: typing.SupportsFloat | typing.SupportsIndex, normal_velocity: typing.SupportsFloat | typing.SupportsIndex, penetration: typing.SupportsFloat | typing.SupportsIndex, cfm: typing.SupportsFloat | typing.SupportsIndex, erp: typing.SupportsFloat | typing.SupportsIndex, time_step: typing.SupportsFloat | typing.SupportsIndex, inverse_mass: typing.SupportsFloat | typing.SupportsIndex) -> float:
    ...
def restitution_target(restitution: typing.SupportsFloat | typing.SupportsIndex, normal_velocity: typing.SupportsFloat | typing.SupportsIndex, velocity_threshold: typing.SupportsFloat | typing.SupportsIndex) -> float:
    ...
CONTACT_COLUMNS: int = 20
LOG_COLUMNS: int = 18
