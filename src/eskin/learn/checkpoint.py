"""Between the torch network and the model file."""

import torch

from eskin.model import Model, ModelCard, checked_weights
from eskin.nn import RecogniserNetwork


def to_model(network: RecogniserNetwork, card: ModelCard) -> Model:
    """The network's weights, for a file.

    Raises:
        ModelError: if they are not such as can be used, after training that diverged.
    """
    state = network.state_dict()
    weights = {name: w.detach().cpu().numpy() for name, w in state.items()}
    return Model(checked_weights(Model(weights, card)), card)


def to_network(model: Model) -> RecogniserNetwork:
    """The network of a model, ready to evaluate.

    Raises:
        ModelError: if the weights are not those of such a network.
    """
    card = model.card
    weights = checked_weights(model)
    network = RecogniserNetwork(
        card.network, len(card.vocabulary), card.kind == "shear"
    )
    network.load_state_dict({name: torch.as_tensor(w) for name, w in weights.items()})
    return network.eval()
