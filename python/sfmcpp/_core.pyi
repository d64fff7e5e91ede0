"""
C++ core of sfmcpp; the public interface is the package sfmcpp.
"""
from __future__ import annotations
import collections.abc
import numpy
import numpy.typing
import typing
import typing_extensions
__all__: list[str] = ['CAMERA_MODELS', 'CONSTRAINT_KINDS', 'CommunicatorExchange', 'ConstraintKind', 'CoreCameraFunction', 'CoreCameraModel', 'CoreIteration', 'CoreLinearModel', 'CoreSummary', 'INSTRUCTION_SET', 'JacobianCheck', 'LEAST_FY', 'LOSS_TABLE_TERMS', 'LossTable', 'PoseSweepOptions', 'SOLVE_OPTIONS', 'SolveOption', 'SolveOptions', 'align_patches', 'check', 'check_jacobians', 'check_part', 'constraint_costs', 'explore_step', 'group_ranks', 'join_records', 'linearize_pose', 'loss_terms', 'nearest_both_ways', 'nearest_of_first', 'number_lines', 'projection_matrices', 'ragged_text', 'read_numbers', 'refine_pose', 'residuals', 'sample_patches', 'solve', 'split_records', 'sweep_pose_weights', 'text_memory', 'undistorted_pixels', 'usable_cores']
class LossTable:
    """
    A robust loss whose derivative is a table.
    """
    def __init__(self, name: str, knots: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], coefficients: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex]) -> None:
        ...
    @property
    def name(self) -> str:
        ...
class SolveOption:
    """
    What is known of an option of a solve.
    """
    @property
    def choices(self) -> list[tuple[str, str]]:
        """
        Names and what they mean, if it has choices.
        """
    @property
    def default(self) -> typing.Any:
        ...
    @property
    def description(self) -> str:
        """
        What it means, without a full stop.
        """
    @property
    def name(self) -> str:
        ...
    @property
    def optional(self) -> bool:
        """
        Whether it may have no value.
        """
    @property
    def rule(self) -> str | None:
        """
        What a number must be, such as 'at least 0'.
        """
    @property
    def type(self) -> str:
        """
        'str', 'int', 'float' or 'bool'.
        """
    @property
    def unit(self) -> str | None:
        ...
    @property
    def unset(self) -> str | None:
        """
        The text for no value; None: None.
        """
class SolveOptions:
    """
    Options of a solve, with the defaults of the core.
    """
    def __init__(self) -> None:
        ...
    def validate(self) -> None:
        """
        Raise InvalidArgument naming every option out of its range.
        """
    @property
    def acceleration(self) -> str:
        """
        Geodesic acceleration of steps by the curvature of the residuals
        """
    @acceleration.setter
    def acceleration(self, arg1: str) -> None:
        ...
    @property
    def algebraic_weights(self) -> str:
        """
        Weights of observations in an algebraic line search
        """
    @algebraic_weights.setter
    def algebraic_weights(self, arg1: str) -> None:
        ...
    @property
    def backtracking_test(self) -> str:
        """
        Acceptance test of the backtracking line search
        """
    @backtracking_test.setter
    def backtracking_test(self, arg1: str) -> None:
        ...
    @property
    def damping_matrix(self) -> str:
        """
        Matrix that λ multiplies
        """
    @damping_matrix.setter
    def damping_matrix(self, arg1: str) -> None:
        ...
    @property
    def function_tolerance(self) -> float:
        """
        Stop when an accepted step decreases the cost by less than this fraction
        """
    @function_tolerance.setter
    def function_tolerance(self, arg1: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
    @property
    def gauge(self) -> str:
        """
        What fixes position, orientation and scale if nothing else does
        """
    @gauge.setter
    def gauge(self, arg1: str) -> None:
        ...
    @property
    def gradient_tolerance(self) -> float:
        """
        Stop when no entry of the gradient exceeds this
        """
    @gradient_tolerance.setter
    def gradient_tolerance(self, arg1: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
    @property
    def initial_damping(self) -> float | None:
        """
        Initial λ; default: that of the method
        """
    @initial_damping.setter
    def initial_damping(self, arg1: typing.SupportsFloat | typing.SupportsIndex | None) -> None:
        ...
    @property
    def initial_radius(self) -> float | None:
        """
        Initial radius of the Dog-Leg; default: that of the method
        """
    @initial_radius.setter
    def initial_radius(self, arg1: typing.SupportsFloat | typing.SupportsIndex | None) -> None:
        ...
    @property
    def intrinsic_steps(self) -> str:
        """
        Treatment of intrinsics while poses are far off
        """
    @intrinsic_steps.setter
    def intrinsic_steps(self, arg1: str) -> None:
        ...
    @property
    def line_search(self) -> str:
        """
        Line search along each step
        """
    @line_search.setter
    def line_search(self, arg1: str) -> None:
        ...
    @property
    def line_search_damping(self) -> float | None:
        """
        Also search in later iterations while λ is above this
        """
    @line_search_damping.setter
    def line_search_damping(self, arg1: typing.SupportsFloat | typing.SupportsIndex | None) -> None:
        ...
    @property
    def line_search_iterations(self) -> int:
        """
        Number of first iterations that use the line search
        """
    @line_search_iterations.setter
    def line_search_iterations(self, arg1: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    @property
    def line_search_on_rejection(self) -> bool:
        """
        Also search in later iterations where the unit step would be rejected
        """
    @line_search_on_rejection.setter
    def line_search_on_rejection(self, arg1: bool) -> None:
        ...
    @property
    def linear_solver(self) -> str:
        """
        Solver of the reduced camera system
        """
    @linear_solver.setter
    def linear_solver(self, arg1: str) -> None:
        ...
    @property
    def loss(self) -> str | LossTable:
        """
        Robust loss
        """
    @loss.setter
    def loss(self, arg1: str | LossTable) -> None:
        ...
    @property
    def loss_scale_px(self) -> float | str:
        """
        Residual over σ at which the loss leaves the parabola; the minimum if the loss is auto; auto: from the median absolute residual at the start
        """
    @loss_scale_px.setter
    def loss_scale_px(self, arg1: typing.SupportsFloat | typing.SupportsIndex | str) -> None:
        ...
    @property
    def max_iterations(self) -> int:
        """
        Maximum number of steps, rejected ones included
        """
    @max_iterations.setter
    def max_iterations(self, arg1: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    @property
    def max_memory_bytes(self) -> float | None:
        """
        Memory limit of the solve beside the problem: another linear solver is chosen, or the problem is refused
        """
    @max_memory_bytes.setter
    def max_memory_bytes(self, arg1: typing.SupportsFloat | typing.SupportsIndex | None) -> None:
        ...
    @property
    def max_seconds(self) -> float | None:
        """
        Time limit
        """
    @max_seconds.setter
    def max_seconds(self, arg1: typing.SupportsFloat | typing.SupportsIndex | None) -> None:
        ...
    @property
    def method(self) -> str:
        """
        Minimiser
        """
    @method.setter
    def method(self, arg1: str) -> None:
        ...
    @property
    def parameter_tolerance(self) -> float:
        """
        Stop when the step is shorter than this fraction of the norm of the unknowns
        """
    @parameter_tolerance.setter
    def parameter_tolerance(self, arg1: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
    @property
    def pcg_forcing(self) -> float:
        """
        Without pcg_tolerance, the iterative linear solver stops at an iteration that gains less than this fraction of the average one
        """
    @pcg_forcing.setter
    def pcg_forcing(self, arg1: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
    @property
    def pcg_max_iterations(self) -> int:
        """
        Maximum iterations of the iterative linear solver
        """
    @pcg_max_iterations.setter
    def pcg_max_iterations(self, arg1: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    @property
    def pcg_tolerance(self) -> float | None:
        """
        Relative residual at which the iterative linear solver stops; default: by pcg_forcing
        """
    @pcg_tolerance.setter
    def pcg_tolerance(self, arg1: typing.SupportsFloat | typing.SupportsIndex | None) -> None:
        ...
    @property
    def point_steps(self) -> str:
        """
        Treatment of points that a step makes worse
        """
    @point_steps.setter
    def point_steps(self, arg1: str) -> None:
        ...
    @property
    def precision(self) -> str:
        """
        Precision in which the Jacobian of the observations is stored
        """
    @precision.setter
    def precision(self, arg1: str) -> None:
        ...
    @property
    def preconditioner(self) -> str:
        """
        Preconditioner of the iterative linear solver
        """
    @preconditioner.setter
    def preconditioner(self, arg1: str) -> None:
        ...
    @property
    def threads(self) -> int:
        """
        Number of threads, does not change the result; 0: by machine and problem size
        """
    @threads.setter
    def threads(self, arg1: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
class CoreIteration:
    """
    One iteration of the minimiser; number 0 is the start.
    """
    @property
    def accelerated(self) -> bool:
        ...
    @property
    def accepted(self) -> bool:
        ...
    @property
    def cost(self) -> float:
        ...
    @property
    def cost_evaluations(self) -> int:
        ...
    @property
    def damping(self) -> float:
        ...
    @property
    def gradient_norm(self) -> float:
        ...
    @property
    def held_points(self) -> int:
        ...
    @property
    def intrinsics_held(self) -> bool:
        ...
    @property
    def iteration(self) -> int:
        ...
    @property
    def line_searched(self) -> bool:
        ...
    @property
    def linear_solver_iterations(self) -> int:
        ...
    @property
    def proposed_lengths(self) -> list[tuple[float, float]]:
        ...
    @property
    def refitted_points(self) -> int:
        ...
    @property
    def seconds(self) -> float:
        ...
    @property
    def step_lengths(self) -> tuple[float, float]:
        ...
    @property
    def step_norm(self) -> float:
        ...
class CoreSummary:
    """
    What a solve did.
    """
    @property
    def constraint_costs(self) -> dict[str, tuple[float, float]]:
        ...
    @property
    def final_cost(self) -> float:
        ...
    @property
    def final_rms_px(self) -> float:
        ...
    @property
    def initial_cost(self) -> float:
        ...
    @property
    def initial_rms_px(self) -> float:
        ...
    @property
    def iterations(self) -> list[CoreIteration]:
        ...
    @property
    def linear_solver(self) -> str:
        ...
    @property
    def linear_solver_changes(self) -> list:
        ...
    @property
    def linear_solver_forecast(self) -> list:
        ...
    @property
    def linear_solver_reason(self) -> str:
        ...
    @property
    def loss_scale_px(self) -> float:
        ...
    @property
    def message(self) -> str:
        ...
    @property
    def observations_behind_camera(self) -> tuple[int, int]:
        ...
    @property
    def point_steps(self) -> str:
        ...
    @property
    def seconds_setup(self) -> float:
        ...
    @property
    def seconds_total(self) -> float:
        ...
    @property
    def termination(self) -> str:
        ...
    @property
    def threads(self) -> int:
        ...
    @property
    def warnings(self) -> list[str]:
        ...
class CommunicatorExchange:
    """
    What the ranks of a solve pass each other, over a communicator as mpi4py's.
    """
    def __init__(self, communicator: typing.Any) -> None:
        ...
    def interrupt(self) -> None:
        """
        Stop the solve of all ranks, as Ctrl-C does.
        """
    @property
    def bytes_sent(self) -> float:
        """
        To other ranks.
        """
    @property
    def messages(self) -> int:
        """
        Collective calls.
        """
    @property
    def seconds_waited(self) -> float:
        """
        For the other ranks and for the network [s].
        """
class JacobianCheck:
    """
    Analytic against numeric derivatives; see sfmcpp.check_jacobians.
    """
    def __getstate__(self) -> tuple[int, float, int, str]:
        ...
    def __repr__(self) -> str:
        ...
    def __setstate__(self, arg0: tuple) -> None:
        ...
    @property
    def entries(self) -> int:
        """
        Derivatives compared.
        """
    @property
    def worst_error(self) -> float:
        """
        Largest difference, relative to its block.
        """
    @property
    def worst_observation(self) -> int:
        """
        Observation of the largest difference.
        """
    @property
    def worst_parameter(self) -> str:
        """
        Parameter of the largest difference.
        """
class PoseSweepOptions:
    """
    Options of pose fits, with the defaults of the core.
    """
    def __init__(self) -> None:
        ...
    @property
    def approximate_leave_one_out(self) -> bool:
        """
        Compute the closed-form score.
        """
    @approximate_leave_one_out.setter
    def approximate_leave_one_out(self, arg0: bool) -> None:
        ...
    @property
    def fold_iterations(self) -> int:
        """
        Steps of a leave-one-out fold.
        """
    @fold_iterations.setter
    def fold_iterations(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    @property
    def inlier_px(self) -> float:
        """
        Largest error of an inlier [px].
        """
    @inlier_px.setter
    def inlier_px(self, arg0: typing.SupportsFloat | typing.SupportsIndex) -> None:
        ...
    @property
    def leave_one_out(self) -> bool:
        """
        Compute the exact score.
        """
    @leave_one_out.setter
    def leave_one_out(self, arg0: bool) -> None:
        ...
    @property
    def max_iterations(self) -> int:
        """
        Steps of a fit at most.
        """
    @max_iterations.setter
    def max_iterations(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
    @property
    def threads(self) -> int:
        """
        Threads for the exact scores; 0: automatic.
        """
    @threads.setter
    def threads(self, arg0: typing.SupportsInt | typing.SupportsIndex) -> None:
        ...
class ConstraintKind:
    """
    What is known of a kind of constraint.
    
    Attributes
    ----------
    name : str
        Name of the kind.
    values : tuple of int or None
        Shape of one measurement; None: the kind has none.
    cameras : tuple of int
        How many cameras a member may name.
    on_poses : bool
        Whether it is on poses; else on intrinsics.
    compares_images : bool
        Whether it needs frozen points to compare the images of.
    freedom : int
        Independent numbers in one measurement: nine entries of a rotation are three.
    unit : str
        Unit of an error d of the sensor.
    spread : float or None
        ``‖d‖² / ε`` to first order, ε the mean squared error; None: the number of its points.
    error : str
        What is squared, before the division by its number of entries.
    frame : str
        Frame of the measurement.
    """
    def __reduce__(self) -> tuple[typing.Any, tuple[str]]:
        ...
    def __repr__(self) -> str:
        ...
    @property
    def cameras(self) -> tuple:
        ...
    @property
    def compares_images(self) -> bool:
        ...
    @property
    def error(self) -> str:
        ...
    @property
    def frame(self) -> str:
        ...
    @property
    def freedom(self) -> int:
        ...
    @property
    def name(self) -> str:
        ...
    @property
    def on_poses(self) -> bool:
        ...
    @property
    def spread(self) -> float | None:
        ...
    @property
    def unit(self) -> str:
        ...
    @property
    def values(self) -> tuple | None:
        ...
class CoreCameraModel:
    """
    What the core knows of a camera model.
    """
    @property
    def can_be_free(self) -> bool:
        """
        Whether any of them may be free.
        """
    @property
    def intrinsics(self) -> list[str]:
        """
        Names, in the order they are stored.
        """
    @property
    def metric(self) -> bool:
        """
        Whether its cameras are poses [R | c].
        """
    @property
    def name(self) -> str:
        ...
class CoreCameraFunction:
    """
    A camera model by a Python function.
    """
    def __init__(self, name: str, intrinsics: collections.abc.Sequence[str], function: typing.Any) -> None:
        ...
class CoreLinearModel:
    """
    The linear model of a problem at one state.
    """
    def __init__(self, arrays: dict, options: SolveOptions, ridge: typing.SupportsFloat | typing.SupportsIndex = 0.0, datum: str = 'cameras') -> None:
        ...
    def __reduce_ex__(self, protocol: typing.SupportsInt | typing.SupportsIndex) -> tuple:
        ...
    def covariance(self, columns: collections.abc.Sequence[typing.SupportsInt | typing.SupportsIndex]) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]:
        ...
    def covariance_blocks(self, columns: typing.Annotated[numpy.typing.ArrayLike, numpy.int32]) -> numpy.typing.NDArray[numpy.float64]:
        ...
    def groups(self) -> list:
        """
        Rows of each constraint group, without its weight.
        """
    def hat(self, group: typing.SupportsInt | typing.SupportsIndex) -> typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]:
        ...
    def hat_spectrum(self, group: typing.SupportsInt | typing.SupportsIndex) -> tuple[typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, 1]"], typing.Annotated[numpy.typing.NDArray[numpy.float64], "[m, n]"]]:
        ...
    def jacobian(self) -> tuple:
        """
        By the camera and by the point of each observation.
        """
    def leverages(self) -> numpy.typing.NDArray[numpy.float64]:
        ...
    def log_determinant(self) -> float:
        ...
    def num_determined(self) -> int:
        ...
    def step(self) -> dict:
        """
        The minimum of the linear model.
        """
    @property
    def camera_columns(self) -> numpy.typing.NDArray[numpy.int32]:
        ...
    @property
    def cost(self) -> float:
        ...
    @property
    def free_intrinsics(self) -> list[str]:
        ...
    @property
    def loss_scale_px(self) -> float:
        ...
    @property
    def num_camera_columns(self) -> int:
        ...
    @property
    def num_columns(self) -> int:
        ...
    @property
    def observation_weights(self) -> numpy.typing.NDArray[numpy.float64]:
        ...
    @property
    def point_columns(self) -> numpy.typing.NDArray[numpy.int32]:
        ...
    @property
    def residuals(self) -> numpy.typing.NDArray[numpy.float64]:
        ...
def align_patches(levels: collections.abc.Sequence[typing.Annotated[numpy.typing.ArrayLike, numpy.float32]], templates: typing.Annotated[numpy.typing.ArrayLike, numpy.float32], which: typing.Annotated[numpy.typing.ArrayLike, numpy.int32], centres: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], steps: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], level: typing.Annotated[numpy.typing.ArrayLike, numpy.int32]) -> tuple:
    """
    Where an image looks like templates: centres (n, 2), correlations (n) (-1: nowhere near) and covariances (n, 3).
    """
def check(arrays: dict) -> list[str]:
    """
    Raise for a broken problem; return what its owner should know.
    """
def check_jacobians(arrays: dict, max_observations: typing.SupportsInt | typing.SupportsIndex = 1000) -> JacobianCheck:
    """
    Analytic against numeric derivatives.
    """
def check_part(arrays: dict) -> None:
    """
    Raise for broken arrays, which need not make a problem without those of others.
    """
def constraint_costs(arrays: dict) -> list[float]:
    """
    Weighted cost of each group.
    """
def explore_step(arrays: dict, options: SolveOptions, lengths: collections.abc.Sequence[tuple[typing.SupportsFloat | typing.SupportsIndex, typing.SupportsFloat | typing.SupportsIndex]]) -> dict:
    """
    Costs along the first step; the arrays `cameras`, `intrinsics`, `points` and `rig_sensors` are moved along it at unit length.
    """
def group_ranks(group: numpy.typing.NDArray[numpy.int32], num_groups: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.int64]:
    """
    How many elements of the same group come before each one.
    """
def join_records(heads: numpy.typing.NDArray[numpy.uint8], items: numpy.typing.NDArray[numpy.uint8], head_bytes: typing.SupportsInt | typing.SupportsIndex, item_bytes: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.uint8]:
    """
    The bytes that split_records takes apart.
    """
def linearize_pose(view: dict, constraints: collections.abc.Sequence[dict], pose: typing.Annotated[numpy.typing.ArrayLike, numpy.float64]) -> dict:
    """
    Normal equations of the images, residuals and Jacobians of the constraints.
    """
def loss_terms(loss: str | LossTable, scale: typing.SupportsFloat | typing.SupportsIndex, squared: typing.Annotated[numpy.typing.ArrayLike, numpy.float64]) -> tuple:
    """
    ρ, ρ′ and d(s ρ′)/ds of squared residuals s.
    """
def nearest_both_ways(first: numpy.typing.NDArray[numpy.uint8], second: numpy.typing.NDArray[numpy.uint8], threads: typing.SupportsInt | typing.SupportsIndex = 0) -> tuple:
    """
    What nearest_of_first says of each, and what it says with both exchanged, at once.
    """
def nearest_of_first(first: numpy.typing.NDArray[numpy.uint8], second: numpy.typing.NDArray[numpy.uint8], threads: typing.SupportsInt | typing.SupportsIndex = 0) -> tuple:
    """
    Nearest of `second` to each of `first`: its number (-1: none), the squared distances to it and to the second nearest (2**29: none).
    """
def number_lines(text: typing_extensions.Buffer, comments: bool = False, threads: typing.SupportsInt | typing.SupportsIndex = 0) -> tuple:
    """
    Lines that hold words: index of the first word, how many, number of the line from 1.
    """
def projection_matrices(arrays: dict) -> numpy.typing.NDArray[numpy.float64]:
    """
    (C, 3, 4) projection matrices to pixels, distortion left out.
    """
def ragged_text(head: collections.abc.Sequence[tuple[str, numpy.ndarray]], after_head: str, item: collections.abc.Sequence[tuple[str, numpy.ndarray]], after_item: str, tail: str, counts: typing.Annotated[numpy.typing.ArrayLike, numpy.int64], threads: typing.SupportsInt | typing.SupportsIndex = 0) -> bytes:
    """
    Rows of text: each head, then the next counts[i] items, then the tail. A column is a pair of the text before it and its values.
    """
def read_numbers(text: typing_extensions.Buffer, comments: bool = False, threads: typing.SupportsInt | typing.SupportsIndex = 0) -> tuple:
    """
    All numbers of a text, and the byte of the first word that is no finite number, or -1.
    """
def refine_pose(view: dict, constraints: collections.abc.Sequence[dict], start: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], options: PoseSweepOptions) -> dict:
    """
    The pose fit with every constraint at its weight.
    """
def residuals(arrays: dict) -> numpy.typing.NDArray[numpy.float64]:
    """
    (M, 2) residuals over their standard deviation.
    """
def sample_patches(levels: collections.abc.Sequence[typing.Annotated[numpy.typing.ArrayLike, numpy.float32]], centres: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], steps: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], level: typing.Annotated[numpy.typing.ArrayLike, numpy.int32], radius: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.float32]:
    """
    Patches (n, 2 radius + 1, 2 radius + 1) of an image; not a number where they are not all within it.
    """
def solve(arrays: dict, options: SolveOptions, callback: typing.Any = None, checkpoint: typing.Any = None, resumed: dict | None = None, exchange: typing.Any = None) -> CoreSummary:
    """
    Minimise; the arrays `cameras`, `intrinsics`, `points` and `rig_sensors` are overwritten with the best state. `checkpoint(where, last)` is called after each iteration; `where()` gives arrays that another call takes as `resumed`. With `exchange`, this is one rank's part of a problem.
    """
def split_records(data: bytes, begin: typing.SupportsInt | typing.SupportsIndex, count: typing.SupportsInt | typing.SupportsIndex, head_bytes: typing.SupportsInt | typing.SupportsIndex, item_bytes: typing.SupportsInt | typing.SupportsIndex) -> tuple:
    """
    Heads and items of the records from byte `begin` on, and where the last one ends that fits.
    """
def sweep_pose_weights(view: dict, constraints: collections.abc.Sequence[dict], selected: typing.SupportsInt | typing.SupportsIndex, weights: collections.abc.Sequence[typing.SupportsFloat | typing.SupportsIndex], start: typing.Annotated[numpy.typing.ArrayLike, numpy.float64], options: PoseSweepOptions) -> dict:
    """
    One pose fit for each weight of the selected constraint; arrays by name.
    """
def text_memory(bytes: typing.SupportsInt | typing.SupportsIndex) -> numpy.typing.NDArray[numpy.uint8]:
    """
    Memory for so many bytes of text, not set; the next solve finds its pages again.
    """
def undistorted_pixels(arrays: dict) -> numpy.typing.NDArray[numpy.float64]:
    """
    (M, 2) pixels as a lens without distortion would have seen them.
    """
def usable_cores() -> int:
    """
    Cores that this process may keep busy: it is bound to no others, or has no more time.
    """
CAMERA_MODELS: tuple
CONSTRAINT_KINDS: tuple
INSTRUCTION_SET: str
LEAST_FY: float = 20.0
LOSS_TABLE_TERMS: int = 8
SOLVE_OPTIONS: tuple
__version__: str
class SolveKeywords(typing.TypedDict, total=False):
    method: typing.Literal['lm', 'lm-nielsen', 'dog-leg', 'gauss-newton', 'gradient-descent', 'conjugate-gradient', 'alternation']
    line_search: typing.Literal['none', 'g-als', 't-als', 'exact', 'soft', 'backtracking']
    line_search_iterations: int
    line_search_damping: float | None
    line_search_on_rejection: bool
    backtracking_test: typing.Literal['armijo', 'strong-wolfe', 'goldstein']
    algebraic_weights: typing.Literal['uniform', 'inverse-depth']
    acceleration: typing.Literal['auto', 'none', 'points', 'geodesic']
    point_steps: typing.Literal['auto', 'whole', 'held-back', 'refitted']
    intrinsic_steps: typing.Literal['auto', 'whole', 'late']
    linear_solver: typing.Literal['auto', 'dense', 'sparse', 'iterative']
    precision: typing.Literal['auto', 'single', 'double']
    loss: typing.Literal['squared', 'huber', 'cauchy', 'tukey', 'geman-mcclure', 'truncated', 'auto'] | LossTable
    loss_scale_px: float | typing.Literal['auto']
    max_iterations: int
    max_seconds: float | None
    function_tolerance: float
    gradient_tolerance: float
    parameter_tolerance: float
    threads: int
    gauge: typing.Literal['auto', 'free', 'fixed']
    initial_damping: float | None
    initial_radius: float | None
    damping_matrix: typing.Literal['identity', 'diagonal']
    pcg_tolerance: float | None
    pcg_max_iterations: int
    pcg_forcing: float
    preconditioner: typing.Literal['auto', 'schur-jacobi', 'clusters', 'two-levels']
    max_memory_bytes: float | None
