"""The fusion filter applied to a stream: motion and covariance between scans."""

from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Float64, Int

from jaxslam.fusion.ekf import EKF, STATE_SIZE, Belief, since_copy, with_copy
from jaxslam.fusion.stream import IMU, ODOMETRY, QUERY, Events, Stream

_START_VARIANCE = (1e-6, 1e-6, 1e-6, 1.0, 1.0, 1.0)


class FusedStep(eqx.Module):
    """Result of one event; stacked over the stream.

    Attributes:
        mean: `[6]` the state after the event.
        variance: `[6]` the diagonal of its covariance.
        delta: `[3]` at a query: motion since the previous query, in the frame of the pose at the previous
            query.
        delta_covariance: `[3, 3]` of `delta`.
        accepted: whether the reading was used.
    """

    mean: Float[Array, "*M 6"]
    variance: Float[Array, "*M 6"]
    delta: Float[Array, "*M 3"]
    delta_covariance: Float[Array, "*M 3 3"]
    accepted: Bool[Array, "*M"]


@dataclass(frozen=True)
class FusedMotion:
    """The fused motion.

    Attributes:
        stamps: `[Q]` stamps of the queries, seconds.
        poses: `[Q, 3]` in the odometry's frame.
        sigmas: `[Q, 3]` standard deviations of the poses (m, m, rad).
        deltas: `[Q, 3]` motion since the previous query; zero for the first.
        covariances: `[Q, 3, 3]` of the deltas.
        readings: number of readings by source.
        refused: number of readings rejected by the gate, by source.
    """

    stamps: Float64[np.ndarray, "Q"]
    poses: Float64[np.ndarray, "Q 3"]
    sigmas: Float64[np.ndarray, "Q 3"]
    deltas: Float64[np.ndarray, "Q 3"]
    covariances: Float64[np.ndarray, "Q 3 3"]
    readings: dict[str, int]
    refused: dict[str, int]


def filter_events(ekf: EKF, start: Float[Array, "3"], events: Events) -> tuple[Belief, FusedStep]:
    """Filter a stream in one `lax.scan`; `start` `[3]` is the pose before the first event."""

    def step(belief: Belief, event: Events) -> tuple[Belief, FusedStep]:
        belief = ekf.predict(belief, event.dt)
        updated = ekf.update(belief, event.measurement)
        belief = updated.belief
        delta, covariance = since_copy(belief)
        asked = event.source == QUERY
        fresh = with_copy(Belief(belief.mean[:STATE_SIZE], belief.covariance[:STATE_SIZE, :STATE_SIZE]))
        after = jax.tree.map(lambda new, old: jnp.where(asked, new, old), fresh, belief)
        return after, FusedStep(
            mean=belief.mean[:STATE_SIZE],
            variance=jnp.diagonal(belief.covariance)[:STATE_SIZE],
            delta=delta,
            delta_covariance=covariance,
            accepted=updated.accepted & event.measurement.any_seen,
        )

    mean = jnp.concatenate([start, jnp.zeros_like(start)])
    belief = with_copy(Belief(mean, jnp.diag(jnp.asarray(_START_VARIANCE, start.dtype))))
    return jax.lax.scan(step, belief, events)


def fuse(ekf: EKF, stream: Stream) -> FusedMotion:
    """Return the fused motion at the queries of a stream."""
    steps = jax.jit(filter_events)(ekf, jnp.asarray(stream.start, jnp.float32), stream.events)[1]
    source: Int[np.ndarray, "M"] = np.asarray(stream.events.source)
    read, accepted = np.asarray(stream.events.measurement.any_seen), np.asarray(steps.accepted)
    rows = stream.query_rows
    deltas = np.asarray(steps.delta, np.float64)[rows]
    covariances = np.asarray(steps.delta_covariance, np.float64)[rows]
    # The first query has no previous one.
    deltas[:1], covariances[:1] = 0.0, 0.0
    names = {"odometry": ODOMETRY, "imu": IMU}
    return FusedMotion(
        stamps=stream.stamps[rows],
        poses=np.asarray(steps.mean, np.float64)[rows, :3],
        sigmas=np.sqrt(np.asarray(steps.variance, np.float64)[rows, :3]),
        deltas=deltas,
        covariances=covariances,
        readings={name: int(np.sum(read & (source == code))) for name, code in names.items()},
        refused={name: int(np.sum(read & ~accepted & (source == code))) for name, code in names.items()},
    )
