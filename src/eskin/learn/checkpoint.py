"""Between the torch network and the model file."""

import torch

from eskin.errors import ModelError
from eskin.model import Model, ModelCard
from eskin.nn import RecogniserNetwork


def to_model(network: RecogniserNetwork, card: ModelCard) -> Model:
    """The network's weights, for a file."""
    state = network.state_dict()
    return Model({name: w.detach().cpu().numpy() for name, w in state.items()}, card)


def to_network(model: Model) -> RecogniserNetwork:
    """The network of a model, ready to evaluate.

    Raises:
        ModelError: if the weights are not those of such a network.
    """
    card = model.card
    network = RecogniserNetwork(
        card.network, len(card.vocabulary), card.kind == "shear"
    )
    weights = {name: torch.as_tensor(w) for name, w in model.weights.items()}
    try:
        network.load_state_dict(weights)
    except RuntimeError as error:
        reason = " ".join(str(error).split())
        raise ModelError(
            f"weights do not fit their card: {reason[:200]}; train the model again"
        ) from None
    return network.eval()
