"""Images of the skin: every taxel has its pixel."""

import numpy as np
import pytest
import torch

from eskin.skin import Patch, Plane, TaxelGrid, Tube, build_skin, load_skin
from helpers.baselines import UR5
from helpers.graphs import motion
from lab.baselines.convolution import (
    PIXEL_HEIGHT,
    PIXELS_AROUND,
    Cnn3d,
    CnnLstm,
    ImageCnn,
    TaxelsToImage,
    build_patch_image,
    build_unrolled_image,
)
from lab.baselines.flat import PRESSURE_UNIT, TIME_BINS, compute_bins

GAP = 0.0103  # between taxels of a patch that is laid here [m]
CAPS = "elbow_cap", "wrist_1_cap"
MEANS = 4.5 + 10.0 * np.arange(TIME_BINS)  # of the parts of `ramp` [kPa]
any_way = pytest.mark.parametrize("seed", [0, 1, 2])
every_skin = pytest.mark.parametrize("name", ["ur5", "ur5-shapes", "bent", "sleeve"])


def laid(rows, columns, surface):
    """One patch on a surface."""
    patch = Patch("patch", "table", 0, rows, columns)
    grid = TaxelGrid(rows, columns, GAP, GAP)
    return build_skin("laid", [(patch, grid, surface)])


def place_pixels(skin):
    """Return row and column of each taxel in the unrolled image."""
    return np.divmod(build_unrolled_image(skin).pixel, PIXELS_AROUND)


def apart_round(one, other):
    """How many columns lie between, the shorter way round."""
    apart = np.abs(one - other)
    return np.minimum(apart, PIXELS_AROUND - apart)


def side_by_side(skin):
    """Pairs of taxels that follow each other in a row or a column of a patch."""
    cells = np.stack([skin.patch_index, skin.rows, skin.columns], axis=1)
    where = {tuple(cell): taxel for taxel, cell in enumerate(cells)}
    steps = (0, 0, 1), (0, 1, 0)
    pairs = [(t, where.get(tuple(cells[t] + s))) for t in where.values() for s in steps]
    return np.array([pair for pair in pairs if pair[1] is not None]).T


def test_patch_images_are_indexed_by_row_column_and_patch():
    skin = UR5.skin
    pressure = torch.arange(1.0, skin.count + 1)
    image = TaxelsToImage(build_patch_image(skin))(pressure)
    for taxel in range(skin.count):
        at = skin.rows[taxel], skin.columns[taxel], skin.patch_index[taxel]
        assert image[at].item() == pytest.approx((taxel + 1) / PRESSURE_UNIT)
    assert (image > 0).sum() == skin.count


@every_skin
@pytest.mark.parametrize("image_of", [build_patch_image, build_unrolled_image])
def test_every_taxel_has_one_pixel(name, image_of):
    skin = load_skin(name)
    pixels = TaxelsToImage(image_of(skin))
    for some in torch.arange(skin.count).split(256):
        images = pixels(PRESSURE_UNIT * torch.eye(skin.count)[some]).flatten(1)
        assert torch.equal(images.sum(dim=1), torch.ones(len(some)))
        assert torch.equal(images.amax(dim=1), torch.ones(len(some)))


def test_neighbours_on_a_link_are_neighbours_in_the_unrolled_image():
    """Caps, which close the end of a link, are excepted."""
    skin = UR5.skin
    rows, columns = place_pixels(skin)
    one, other = side_by_side(skin)
    ids = np.array([patch.id for patch in skin.patches])[skin.patch_index[one]]
    round_link = ~np.isin(ids, CAPS)
    assert np.abs(rows[one] - rows[other])[round_link].max() <= 2
    assert apart_round(columns[one], columns[other])[round_link].max() <= 2


@any_way
def test_a_ring_is_unrolled_about_its_axis_in_any_pose(seed):
    """One that nearly closes, wider than it is high."""
    skin = laid(5, 18, Tube(0.03, motion(seed, far=0.1)))
    rows, columns = (place.reshape(5, 18) for place in place_pixels(skin))
    assert rows.max() == int(4 * GAP / PIXEL_HEIGHT)
    turn = np.arange(18) * GAP / (2 * np.pi * 0.03) * PIXELS_AROUND
    off = apart_round(columns, columns[:, :1]) - apart_round(turn, 0)
    assert np.abs(off).max() <= 1


@any_way
def test_a_flat_skin_is_spread_over_rows_and_columns(seed):
    skin = laid(12, 20, Plane(motion(seed, far=0.1)))
    rows, columns = place_pixels(skin)
    one, other = side_by_side(skin)
    assert np.abs(rows[one] - rows[other]).max() <= 2
    assert apart_round(columns[one], columns[other]).max() <= 2
    assert len(np.unique(rows)) == 20
    assert len(np.unique(columns)) >= 10


def ramp(skin, taxel):
    """A window in which the pressure of one taxel [kPa] is the index of the reading."""
    pressure = torch.zeros(1, 100, skin.count)
    pressure[0, :, taxel] = torch.arange(100.0)
    return pressure


def test_bins_are_the_means_of_ten_consecutive_parts_in_order():
    rows = compute_bins(ramp(UR5.skin, 700).numpy()).reshape(TIME_BINS, -1)
    np.testing.assert_allclose(rows[:, 700], MEANS / PRESSURE_UNIT, rtol=1e-6)
    assert not np.delete(rows, 700, axis=1).any()


def seen_by(network, pressure):
    """What the convolutions of a network are given."""
    seen = []
    network.convolutions.register_forward_pre_hook(lambda _, given: seen.append(given))
    with torch.inference_mode():
        network(pressure, torch.zeros(1, 100, 6))
    return seen[0][0].numpy()


@pytest.mark.parametrize("taxel", [3, 700, 2111])
def test_networks_get_readings_and_taxels_in_order(taxel):
    skin = UR5.skin
    pressure = ramp(UR5.skin, taxel)
    row = skin.rows[taxel]
    column = skin.columns[taxel]
    patch = skin.patch_index[taxel]
    want = np.arange(100.0) / PRESSURE_UNIT
    readings = seen_by(CnnLstm(skin, 3), pressure)[:, patch, row, column]
    np.testing.assert_allclose(readings, want, rtol=1e-6)
    volume = seen_by(Cnn3d(skin, 3), pressure)[0, patch, :, row, column]
    np.testing.assert_allclose(volume, want, rtol=1e-6)
    at = tuple(place[taxel] for place in place_pixels(skin))
    parts = seen_by(ImageCnn(skin, 3), pressure)[0, :, *at]
    np.testing.assert_allclose(parts, MEANS / PRESSURE_UNIT, rtol=1e-6)


def test_unrolled_convolutions_are_periodic_around_the_link():
    torch.manual_seed(0)
    convolutions = ImageCnn(UR5.skin, 3).double().convolutions
    image = torch.randn(1, TIME_BINS, 93, PIXELS_AROUND).double()
    with torch.inference_mode():
        one = convolutions(image)
        round_it = convolutions(image.roll(8, dims=-1))
        along_it = convolutions(image.roll(8, dims=-2))
    torch.testing.assert_close(one, round_it, atol=1e-12, rtol=1e-12)
    assert (one - along_it).abs().max() > 1e-6
