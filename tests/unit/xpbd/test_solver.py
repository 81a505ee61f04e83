from dataclasses import replace

import numpy as np
import pytest
import warp as wp
from threadpoolctl import threadpool_limits

from drapeline.errors import InputError
from drapeline.geometry.point_cache import PointCache
from drapeline.simulation.settings import HealthBounds, SimulationSettings
from drapeline.simulation.simulate import simulate_outfit
from drapeline.xpbd.solver import cloth_solver
from toys.bounds import NO_BOUNDS
from toys.cloth import FRAMES, dress, skirt


def test_it_is_named_with_its_numbers_and_version():
    solver = cloth_solver(1)
    assert solver.name == "xpbd"
    assert solver.settings["steps_per_step"] == 3.0
    assert solver.versions() == {"warp": wp.config.version}


def test_it_takes_a_gpu_where_there_is_one_and_it_may(monkeypatch):
    monkeypatch.setattr(wp, "is_cuda_available", lambda: True)
    assert [cloth_solver(1, name).device for name in ("cpu", "auto", "gpu")] == [
        *("cpu", "cuda", "cuda")
    ]
    assert cloth_solver(1, "gpu").settings["parallel"]
    monkeypatch.setattr(wp, "is_cuda_available", lambda: False)
    assert cloth_solver(1, "auto") == cloth_solver(1)
    with pytest.raises(InputError, match=r"^simulation.accelerator is gpu, but .* no CUDA device"):
        cloth_solver(1, "gpu")


def test_a_skirt_follows_the_body_and_is_accepted(tmp_path, toy_body, accelerator):
    status = simulate_outfit(
        tmp_path / "00001",
        dress(toy_body),
        cloth_solver(1, accelerator),
        settings=SimulationSettings(
            steps_min=6,
            steps_max=6,
            shape_frames=2,
            pose_frames=3,
            settle_frames=0,
            collider_share=0.5,
        ),
        bounds=HealthBounds(stretch_low=0.9, stretch_high=1.1),
    )
    assert status["status"] == "accepted", status["reason"]
    assert status["solver"]["name"] == "xpbd"
    with PointCache(tmp_path / "00001/Skirt.f32", len(skirt().vertices)) as cache:
        frames = cache.frames()
    assert len(frames) == FRAMES
    # The waistband stays at the waist, the hem falls in folds.
    assert np.abs(frames[:, :36].mean(axis=1) - skirt().vertices[:36].mean(axis=0)).max() < 0.02
    assert np.abs(frames[-1] - skirt().vertices).max() > 0.005


def test_a_sample_of_two_layers_is_the_same_to_the_byte_whatever_the_threads(
    tmp_path, toy_body, accelerator
):
    dressed = dress(toy_body)
    outer = replace(skirt(), name="Dress", vertices=skirt().vertices * np.float32([1.05, 1.05, 1]))
    dressed = replace(dressed, outfit=replace(dressed.outfit, garments=(skirt(), outer)))
    for threads in (1, 2):
        with threadpool_limits(threads):
            status = simulate_outfit(
                tmp_path / str(threads),
                dressed,
                cloth_solver(threads, accelerator),
                settings=SimulationSettings(steps_min=6, steps_max=6, attempts=1),
                bounds=NO_BOUNDS,
            )
        assert status["status"] == "accepted", status["reason"]
    for name in ("Skirt.f32", "Dress.f32", "health.npz"):
        one, two = (tmp_path / str(threads) / name for threads in (1, 2))
        assert one.read_bytes() == two.read_bytes()
