"""The z-test over pixels: it lets noise pass, and finds one wrong pixel or a small bias of all."""

import numpy as np
import pytest

from runtime.agreement import agreement
from runtime.estimate import Estimate

PIXELS, SAMPLES, NOISE = 2000, 64, 0.4


def estimate(seed: int, light: np.ndarray) -> Estimate:
    """Of `light` (n, 3), with independent normal noise of NOISE a sample."""
    rng = np.random.default_rng(seed)
    halves = [light + rng.normal(size=(len(light), 1)) * NOISE / np.sqrt(SAMPLES / 2) for _ in range(2)]
    error = np.full(len(light), NOISE / np.sqrt(SAMPLES))
    return Estimate((halves[0] + halves[1]) / 2, *halves, error, SAMPLES)


@pytest.fixture
def light():
    return np.random.default_rng(0).uniform(0.5, 2.0, (PIXELS, 3))


def test_noise_alone_is_called_different_as_often_as_asked(light):
    found = [
        agreement(estimate(2 * k, light), estimate(2 * k + 1, light), risk=0.05).holds for k in range(200)
    ]
    assert 0.8 < np.mean(found) < 0.97  # two tests at 5 % each


def test_the_limit_grows_with_the_number_of_pixels(light):
    few, many = (agreement(estimate(0, light[:n]), estimate(1, light[:n])) for n in (10, PIXELS))
    assert few.limit == pytest.approx(3.89, abs=0.01)
    assert many.limit == pytest.approx(5.03, abs=0.01)
    assert few.bias_limit == many.bias_limit == pytest.approx(3.29, abs=0.01)


def test_one_wrong_pixel_is_found(light):
    wrong = light.copy()
    wrong[777] += 0.7  # ten standard errors
    found = agreement(estimate(0, light), estimate(1, wrong))
    assert not found.holds
    assert np.abs(found.z).argmax() == 777
    assert abs(found.bias_z) < found.bias_limit


def test_a_bias_that_no_pixel_shows_is_found(light):
    found = agreement(estimate(0, light), estimate(1, 0.99 * light))
    assert np.abs(found.z).max() < found.limit
    assert not found.holds
    assert found.bias == pytest.approx(0.01, rel=0.3)
    assert "differ" in found.describe()


def test_groups_sum_their_pixels(light):
    first, second = estimate(0, light), estimate(1, light)
    found = agreement(first, second, pixels_a_group=300)
    assert len(found.z) == 7
    difference = (first.value - second.value).mean(axis=1)[1800:].sum()
    assert found.z[-1] == pytest.approx(difference / (np.sqrt(2 * 200) * NOISE / 8), rel=0.02)


def test_equal_light_without_noise_agrees_and_other_does_not():
    dark, lit = (Estimate(v, v, v, np.zeros(4), 8) for v in (np.zeros((4, 3)), np.ones((4, 3))))
    assert agreement(dark, dark).holds and agreement(lit, lit).holds
    assert not agreement(dark, lit).holds


def test_other_pixels_are_refused(light):
    with pytest.raises(ValueError, match="cannot be compared"):
        agreement(estimate(0, light), estimate(1, light[:5]))
