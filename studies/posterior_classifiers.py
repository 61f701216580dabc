"""Classifiers that `posterior_forms.py` compares: each is trained on labelled summaries.

The package's network; scikit-learn's MLPClassifier and HistGradientBoostingClassifier; two networks
of torch. scikit-learn comes with VSR2; torch does not (`pip install torch`), and is imported only
where its forms are trained.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_softmax

from vsr2.posterior.network import NETWORK, train_network
from vsr2.posterior.sets import Sets
from vsr2.posterior.within_library import TRAINING

Array = NDArray[np.float64]
Rows = NDArray[np.int64]
Says = Callable[[Array], Array]
"""From inputs, shape (n, inputs), to log probabilities of labels, shape (n, labels)."""
PACKAGE = "the package's network"


@dataclass(frozen=True)
class FormConstants:
    """Settings of the other forms; chosen by hand, by the score of held-out campaigns at tier M.

    Attributes:
        penalties: of scikit-learn's network, of which the best is taken.
        passes: of the networks of scikit-learn and torch.
        trees: of each label.
        leaves: of each tree.
        bins: of each input.
        tree_rate: by which trees are added.
        least_leaf: copies of campaigns in a leaf.
        normed: widths of torch's layers with normalisation.
        normed_dropout: share of their units that a step leaves out.
        torch_decay: of torch's weights.
    """

    penalties: tuple[float, ...] = (0.3, 1.0, 3.0)
    passes: int = 60
    trees: int = 80
    leaves: int = 3
    bins: int = 48
    tree_rate: float = 0.1
    least_leaf: int = 20
    normed: tuple[int, ...] = (256, 256, 256)
    normed_dropout: float = 0.4
    torch_decay: float = 1.0


FORM = FormConstants()


@dataclass(frozen=True, eq=False)
class Labelled:
    """Campaigns with no effect or one.

    Attributes:
        inputs: of each copy, shape (copies, n, inputs).
        label: 0 none, then the effects, shape (n,).
        weight: of each, so that kinds count as in the prior, shape (n,).
        labels: number of labels.
    """

    inputs: Array
    label: Rows
    weight: Array
    labels: int

    def of(self, rows: Rows) -> Labelled:
        """Some of the campaigns."""
        return Labelled(self.inputs[:, rows], self.label[rows], self.weight[rows], self.labels)

    def drawn(self, rng: np.random.Generator) -> tuple[Array, Rows, Array]:
        """One pass of training, as the package's has it: inputs, labels, weights."""
        rows = rng.permutation(np.tile(np.arange(self.label.size), TRAINING.passed))
        copy = rng.integers(0, len(self.inputs), rows.size)
        return self.inputs[copy, rows], self.label[rows], self.weight[rows]

    def score(self, log_probability: Array) -> float:
        """Weighted mean of minus the log probability of the truth [nat]."""
        own = log_probability[np.arange(self.label.size), self.label]
        return float(-np.average(own, weights=self.weight))


Form = Callable[[Labelled, Labelled, int], Says]
"""Trained on campaigns, stopped by the second copy of others, with a seed."""


def package(train: Labelled, held: Labelled, seed: int) -> Says:
    """The network of a diagnosis, over none and single effects."""
    sets = Sets(tuple(str(k) for k in range(1, train.labels)), 1)

    judged = (held.inputs[1], held.label, held.weight)
    network = train_network(sets, train.drawn, judged, np.random.default_rng(seed))

    def says(inputs: Array) -> Array:
        found = network.log_probability(inputs)[:, :-1]
        return np.asarray(log_softmax(found, axis=1))

    return says


def scikit_network(train: Labelled, held: Labelled, seed: int) -> Says:
    """scikit-learn's MLPClassifier, of the same layers; the best pass of all penalties."""
    from sklearn.neural_network import MLPClassifier

    best = np.inf
    kept: tuple[Any, list[Array], list[Array]] = (None, [], [])
    for penalty in FORM.penalties:
        rng = np.random.default_rng(seed)
        network = MLPClassifier(
            NETWORK.hidden, alpha=penalty, batch_size=NETWORK.batch, random_state=seed
        )
        for _ in range(FORM.passes):
            inputs, label, weight = train.drawn(rng)
            network.partial_fit(
                inputs, label, classes=np.arange(train.labels), sample_weight=weight
            )
            score = held.score(logarithm(network.predict_proba(held.inputs[1])))
            if score < best:
                weights, biases = (
                    [one.copy() for one in layers]
                    for layers in (network.coefs_, network.intercepts_)
                )
                best, kept = score, (network, weights, biases)
    chosen = kept[0]
    chosen.coefs_, chosen.intercepts_ = kept[1:]
    return lambda inputs: logarithm(chosen.predict_proba(inputs))


def boosted_trees(train: Labelled, held: Labelled, seed: int) -> Says:
    """scikit-learn's HistGradientBoostingClassifier on all copies, cut to the best number."""
    from sklearn.ensemble import HistGradientBoostingClassifier

    copies = len(train.inputs)
    trees = HistGradientBoostingClassifier(
        learning_rate=FORM.tree_rate, max_iter=FORM.trees, max_leaf_nodes=FORM.leaves,
        max_bins=FORM.bins, min_samples_leaf=FORM.least_leaf, early_stopping=False,
        random_state=seed,
    )  # fmt: skip
    inputs = train.inputs.reshape(-1, train.inputs.shape[2])
    trees.fit(inputs, np.tile(train.label, copies), np.tile(train.weight, copies))
    scores = [held.score(logarithm(p)) for p in trees.staged_predict_proba(held.inputs[1])]
    best = int(np.argmin(scores))

    def says(inputs: Array) -> Array:
        return logarithm(
            next(p for k, p in enumerate(trees.staged_predict_proba(inputs)) if k == best)
        )

    return says


def torch_network(train: Labelled, held: Labelled, seed: int, *, normed: bool = False) -> Says:
    """Torch's network, of the package's layers, or deeper ones with normalisation."""
    torch: Any = import_module("torch")
    torch.manual_seed(seed)
    torch.set_num_threads(1)
    sizes = FORM.normed if normed else NETWORK.hidden
    layers, width = [], train.inputs.shape[2]
    for size in sizes:
        layers.append(torch.nn.Linear(width, size))
        layers += [torch.nn.LayerNorm(size), torch.nn.GELU()] if normed else [torch.nn.ReLU()]
        layers.append(torch.nn.Dropout(FORM.normed_dropout if normed else NETWORK.dropout))
        width = size
    network = torch.nn.Sequential(*layers, torch.nn.Linear(width, train.labels))
    adam = torch.optim.AdamW(network.parameters(), NETWORK.rate, weight_decay=FORM.torch_decay)
    falling = torch.optim.lr_scheduler.CosineAnnealingLR(adam, FORM.passes)
    rng = np.random.default_rng(seed)

    def says(inputs: Array) -> Array:
        network.eval()
        with torch.no_grad():
            out = network(torch.as_tensor(inputs, dtype=torch.float32))
            return np.asarray(torch.log_softmax(out, 1).double().numpy())

    best, kept = np.inf, network.state_dict()
    for _ in range(FORM.passes):
        inputs, label, weight = (torch.as_tensor(one) for one in train.drawn(rng))
        network.train()
        for rows in torch.arange(len(label)).split(NETWORK.batch):
            loss = torch.nn.functional.cross_entropy(
                network(inputs[rows].float()), label[rows], reduction="none"
            )
            adam.zero_grad()
            ((loss * weight[rows]).sum() / weight[rows].sum()).backward()
            adam.step()
        falling.step()
        score = held.score(says(held.inputs[1]))
        if score < best:
            best, kept = score, {name: one.clone() for name, one in network.state_dict().items()}
    network.load_state_dict(kept)
    return says


def normed_network(train: Labelled, held: Labelled, seed: int) -> Says:
    """torch's, deeper."""
    return torch_network(train, held, seed, normed=True)


FORMS: dict[str, Form] = {
    PACKAGE: package,
    "scikit-learn's MLP": scikit_network,
    "boosted trees": boosted_trees,
}
TORCH: dict[str, Form] = {
    "torch, the same layers": torch_network,
    "torch, three normed layers": normed_network,
}


def logarithm(probability: Array) -> Array:
    """Of probabilities, of which some may be 0."""
    return np.asarray(np.log(np.maximum(probability, np.finfo(np.float64).tiny)))
