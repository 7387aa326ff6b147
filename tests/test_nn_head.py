"""The temporal head: readings at any rate on a clock of 20 ms."""

import pytest
import torch

from eskin.nn.head import (
    PartialConvolution,
    TemporalHead,
    compute_elapsed_share,
    compute_statistics,
    scatter_to_slots,
)

SLOTS, INPUTS = 100, 6


def head(dtype=torch.float32) -> TemporalHead:
    torch.manual_seed(0)
    made = TemporalHead(INPUTS, channels=8, classes=4, dropout=0.5).to(dtype).eval()
    with torch.no_grad():
        for parameter in made.parameters():
            parameter += 0.1 * torch.randn_like(parameter)
    return made


def windows(count=5, share=0.6):
    """Embeddings and which slots hold a reading; never none at all."""
    generator = torch.Generator().manual_seed(1)
    e = torch.randn(count, SLOTS, INPUTS, generator=generator)
    present = (torch.rand(count, SLOTS, generator=generator) < share).float()
    present[:, -1] = 1.0
    return e, present


@torch.no_grad()
def test_a_window_without_any_reading_has_finite_logits():
    e, present = windows()
    logits = head()(e, 0 * present)
    assert torch.isfinite(logits).all()
    torch.testing.assert_close(logits, logits[:1].expand_as(logits))


def test_a_window_without_any_reading_has_finite_gradients():
    net = head()
    e, present = windows()
    present[2] = 0.0
    e.requires_grad_(True)
    net(e, present).square().sum().backward()
    gradients = [e.grad, *(p.grad for p in net.parameters())]
    assert all(torch.isfinite(g).all() for g in gradients)
    assert not e.grad[2].any()


@torch.no_grad()
@pytest.mark.parametrize("share", [0.0, 0.05, 0.6])
def test_what_stands_in_a_slot_without_a_reading_does_not_matter(share):
    e, present = windows(share=share)
    other = torch.where(present[:, :, None] > 0, e, 1e3 * torch.randn_like(e))
    torch.testing.assert_close(head()(other, present), head()(e, present))


@torch.no_grad()
def test_each_window_is_judged_alone():
    e, present = windows()
    together = head()(e, present)
    for n in range(len(e)):
        alone = head()(e[n : n + 1], present[n : n + 1])
        torch.testing.assert_close(alone[0], together[n], rtol=1e-4, atol=1e-5)


@torch.no_grad()
def test_every_slot_matters_where_it_holds_a_reading():
    """The convolutions may leave out the oldest slots; the statistics may not."""
    net = head(torch.float64)
    e, present = torch.randn(1, SLOTS, INPUTS).double(), torch.ones(1, SLOTS).double()
    want = net(e, present)
    for slot in range(SLOTS):
        other = e.clone()
        other[0, slot] += 5.0
        assert not torch.allclose(net(other, present), want, atol=1e-6), slot


@torch.no_grad()
def test_the_share_covered_is_that_since_the_first_reading_whatever_came_between():
    present = torch.zeros(4, SLOTS)
    present[0, 20:] = 1.0
    present[1, 20::7] = 1.0
    present[2, [20, 99]] = 1.0
    share = compute_elapsed_share(present)
    assert share[:3].flatten().tolist() == pytest.approx([0.8] * 3)
    assert share[3].item() == 0.0


@torch.no_grad()
def test_the_last_statistic_is_an_integral_and_the_others_know_no_duration():
    """A steady touch twice as long has twice the integral, at any rate of readings."""
    level = torch.tensor([[0.7], [-0.3]])
    found = {}
    for name, slots in (
        ("long", range(20, 100)),
        ("short", range(60, 100)),
        ("seldom", range(20, 100, 5)),
    ):
        mask = torch.zeros(1, 1, 100)
        mask[0, 0, list(slots)] = 1.0
        parts = compute_statistics(
            level[None] * mask, mask, compute_elapsed_share(mask[:, 0])
        )
        found[name] = parts[0].view(4, 2)
    for other in ("short", "seldom"):
        torch.testing.assert_close(found[other][:3], found["long"][:3])
    torch.testing.assert_close(found["long"][3], 2 * found["short"][3])
    torch.testing.assert_close(found["long"][3], found["seldom"][3])
    torch.testing.assert_close(found["long"][3], 0.8 * level[:, 0])


@torch.no_grad()
@pytest.mark.parametrize("slots", range(9, 24))
def test_a_convolution_ends_with_the_last_slot(slots):
    layer = PartialConvolution(3, kernel=9, stride=4)
    x, present = torch.randn(1, 3, slots), torch.ones(1, 1, slots)
    other = x.clone()
    other[:, :, -1] += 1.0
    want, mask = layer(x, present)
    found, _ = layer(other, present)
    assert not torch.allclose(found[:, :, -1], want[:, :, -1])
    torch.testing.assert_close(found[:, :, :-1], want[:, :, :-1])
    assert want.shape[2] == mask.shape[2] == (slots - 9) // 4 + 1


@torch.no_grad()
def test_a_steady_touch_is_filtered_alike_at_any_rate():
    """Sums over the slots present are scaled up as if all were (Liu et al. 2018)."""
    layer = PartialConvolution(3, kernel=8, stride=4)
    layer.conv.weight.copy_(layer.conv.weight.mean(dim=2, keepdim=True).expand(3, 3, 8))
    x = torch.randn(1, 3, 1).expand(1, 3, 40)
    full, _ = layer(x, torch.ones(1, 1, 40))
    half, _ = layer(x, torch.tensor([1.0, 0.0]).repeat(20)[None, None])
    torch.testing.assert_close(half, full)


@torch.no_grad()
def test_a_convolution_says_nothing_where_it_saw_no_reading():
    layer = PartialConvolution(3, kernel=9, stride=4)
    layer.bias.fill_(1.0)
    x, present = torch.randn(2, 3, 100), torch.zeros(2, 1, 100)
    present[0, 0, 70] = 1.0
    found, mask = layer(x, present)
    seen = [any(70 == slot for slot in range(a, a + 9)) for a in range(3, 92, 4)]
    assert mask[0, 0].bool().tolist() == seen
    assert not mask[1].any()
    assert not found[(mask == 0).expand_as(found)].any()
    assert found[0][:, mask[0, 0] > 0].all()


@torch.no_grad()
def test_several_readings_in_a_slot_are_their_maximum():
    e = torch.tensor([[1.0, -5.0], [3.0, -7.0], [-2.0, -6.0], [9.0, 9.0]])
    window, slot = torch.tensor([0, 0, 0, 1]), torch.tensor([2, 2, 0, 1])
    filled, present = scatter_to_slots(e, window, slot, 2, 3)
    assert filled.tolist() == [
        [[-2.0, -6.0], [0.0, 0.0], [3.0, -5.0]],
        [[0.0, 0.0], [9.0, 9.0], [0.0, 0.0]],
    ]
    assert present.tolist() == [[1.0, 0.0, 1.0], [0.0, 1.0, 0.0]]


@torch.no_grad()
def test_the_order_of_readings_and_reading_one_twice_do_not_matter():
    generator = torch.Generator().manual_seed(2)
    e = torch.randn(60, INPUTS, generator=generator)
    window = torch.randint(0, 3, (60,), generator=generator)
    slot = torch.randint(0, SLOTS, (60,), generator=generator)
    want = scatter_to_slots(e, window, slot, 3, SLOTS)
    order = torch.cat([torch.randperm(60, generator=generator), torch.arange(20)])
    found = scatter_to_slots(e[order], window[order], slot[order], 3, SLOTS)
    assert all(torch.equal(a, b) for a, b in zip(found, want, strict=True))


@torch.no_grad()
def test_windows_without_readings_are_empty():
    none = torch.zeros(0, dtype=torch.int64)
    filled, present = scatter_to_slots(torch.zeros(0, INPUTS), none, none, 2, SLOTS)
    assert filled.shape == (2, SLOTS, INPUTS)
    assert not filled.any() and not present.any()
