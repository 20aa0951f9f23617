"""RoboVirtuoso's encoders of a piano observation, for actors and critics of SAC, TD3 and TQC.

Source: RoboVirtuoso (2023), section 7.2 and table 4, whose numbers of parameters these have.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

import torch
from annotated_types import MultipleOf
from gymnasium import spaces
from stable_baselines3.common.torch_layers import create_mlp, get_actor_critic_arch
from stable_baselines3.common.type_aliases import Schedule
from torch import Tensor, nn

from sb3_piano.envs.observation import ObservationLayout
from sb3_piano.exceptions import ConfigError
from sb3_piano.policies.networks import OwnActor
from sb3_piano.policies.regularized import (
    RegularizedCritics,
    RegularizedSACPolicy,
    RegularizedTD3Policy,
    RegularizedTQCPolicy,
)
from sb3_piano.settings import Count, Share, Unit, checked

POOLED_STEPS = 10
"""Control steps per convolution output: "kernel size = stride = 10" in the report."""

_MAX_TOKENS = 512  # BERT's

_Even = Annotated[Count, MultipleOf(2), Unit(", even, as the actor has two heads")]

EncoderName = Literal["mlp", "conv", "transformer"]


class FlatEncoder(nn.Module):
    """Concatenate goal, finger labels and state: the input of the paper's MLP.

    Args:
        layout: Layout of the observation, with a block ``goal``. Finger labels are the block
            ``lookahead_fingering`` or, without one, ``fingering``, which is its first row.
        n_actions: Size of a critic's action, appended to the observation: part of the state.
    """

    outputs: int
    """Number of features."""

    def __init__(self, layout: ObservationLayout, n_actions: int) -> None:
        super().__init__()
        labels = [name for name in ("lookahead_fingering", "fingering") if name in layout]
        rolls = [layout[name] for name in ("goal", *labels[:1])]
        others = [b for b in layout.values() if b.name not in ("goal", *labels)]
        self._rolls = [(b.slice, b.size // b.shape[-1], b.shape[-1]) for b in rolls]
        self._state = [*(b.slice for b in others), slice(layout.size, layout.size + n_actions)]
        self._n_state = sum(b.size for b in others) + n_actions
        self.outputs = sum(block.size for block in rolls) + self._n_state

    def forward(self, inputs: Tensor) -> Tensor:
        """Return features, (batch, outputs)."""
        rolls, state = self._parts(inputs)
        return torch.cat([*(roll.flatten(1) for roll in rolls), state], dim=1)

    def _parts(self, inputs: Tensor) -> tuple[list[Tensor], Tensor]:
        """Return goal and labels, (batch, rows, n) each, and the state, (batch, n)."""
        rolls = [inputs[:, at].unflatten(1, (rows, n)) for at, rows, n in self._rolls]
        return rolls, torch.cat([inputs[:, at] for at in self._state], dim=1)


class ConvEncoder(FlatEncoder):
    """Convolve the goal of later steps, ten at a time; append it to goal, labels and state.

    Args:
        layout: As of :class:`FlatEncoder`. The goal, and labels of more than one row, look ahead a
            multiple of ten control steps.
        n_actions: As there.
        width: Outputs of a convolution of ten rows; by default as many as a row has.

    Raises:
        ConfigError: If the lookahead is no such multiple.
    """

    def __init__(self, layout: ObservationLayout, n_actions: int, width: int | None = None) -> None:
        super().__init__(layout, n_actions)
        n_goal = self._rolls[0][1]
        for _, rows, _ in self._rolls:
            if n_goal == 1 or (n_goal - 1) % POOLED_STEPS or rows not in (1, n_goal):
                raise ConfigError(
                    f"The observation looks {rows - 1} control steps ahead: expected a multiple of "
                    f"{POOLED_STEPS}, the same for goal and finger labels. Wrap the environment in "
                    f"sb3_piano.wrappers.Lookahead(env, steps={POOLED_STEPS}, fingers=True)."
                )
        self._ahead = [index for index, (_, rows, _) in enumerate(self._rolls) if rows > 1]
        self.convolutions = nn.ModuleList(
            nn.Conv1d(n, width or n, POOLED_STEPS, stride=POOLED_STEPS)
            for _, rows, n in self._rolls
            if rows > 1
        )
        widths = [(1 + (rows - 1) // POOLED_STEPS) * n for _, rows, n in self._rolls]
        self.outputs = self._n_state + sum(widths)

    def forward(self, inputs: Tensor) -> Tensor:
        """Return features, (batch, outputs)."""
        rolls, state = self._parts(inputs)
        later = [pooled.flatten(1) for pooled in self._pool(rolls)]
        return torch.cat([*(roll[:, 0] for roll in rolls), *later, state], dim=1)

    def _pool(self, rolls: list[Tensor]) -> list[Tensor]:
        """Convolve the rows after the first: (batch, rows / 10, width)."""
        pairs = zip(self.convolutions, self._ahead, strict=True)
        return [convolution(rolls[index][:, 1:].mT).mT for convolution, index in pairs]


class _FirstToken(nn.TransformerEncoderLayer):
    """Transformer layer that computes its first token alone."""

    def forward(self, src: Tensor, *args: Any, **kwargs: Any) -> Tensor:
        """Return the first token, (batch, 1, width), of tokens (batch, tokens, width)."""
        first = src[:, :1]
        seen = self.self_attn(first, src, src, need_weights=False)[0]
        first = self.norm1(first + self.dropout1(seen))
        return self.norm2(first + self._ff_block(first))


class TransformerEncoder(ConvEncoder):
    """Return a transformer's output at its first token.

    The tokens are what is due now, what is due later (one for ten control steps) and the state;
    embeddings of goal and labels are added.

    Args:
        layout: As of :class:`ConvEncoder`.
        n_actions: As there.
        heads: Heads of attention.
        width: Numbers of a token; a layer's hidden ones are four times as many, as BERT's.
        n_layers: Layers, 1 or more.
        dropout: Probability with which an activation is dropped while training.
        attention_dropout: The same for weights of attention.
        state_first: Whether the state is the first token, as in the paper's figure 2, or the last,
            as in its authors' code, where the first is what is due now.
    """

    def __init__(
        self,
        layout: ObservationLayout,
        n_actions: int,
        heads: int,
        width: int = 128,
        n_layers: int = 3,
        dropout: float = 0.0,
        attention_dropout: float = 0.0,
        state_first: bool = False,
    ) -> None:
        super().__init__(layout, n_actions, width)
        self._state_first = state_first
        self.now = nn.ModuleList(nn.Linear(n, width) for *_, n in self._rolls)
        self.state = nn.Linear(self._n_state, width)
        self.positions = nn.Parameter(0.02 * torch.randn(_MAX_TOKENS, width))  # as BERT's
        self.norm, self.dropout = nn.LayerNorm(width), nn.Dropout(dropout)
        self.layers = nn.Sequential()
        for kind in [nn.TransformerEncoderLayer] * (n_layers - 1) + [_FirstToken]:
            layer = kind(width, heads, 4 * width, dropout, activation="gelu", batch_first=True)
            layer.self_attn.dropout = attention_dropout
            self.layers.append(layer)
        self.outputs = width

    def forward(self, inputs: Tensor) -> Tensor:
        """Return features, (batch, outputs)."""
        rolls, state = self._parts(inputs)
        now = torch.stack(
            [embed(roll[:, 0]) for embed, roll in zip(self.now, rolls, strict=True)]
        ).sum(dim=0)
        later = torch.stack(self._pool(rolls)).sum(dim=0)
        due, rest = torch.cat([now[:, None], later], dim=1), self.state(state)[:, None]
        tokens = torch.cat([rest, due] if self._state_first else [due, rest], dim=1)
        tokens = self.dropout(self.norm(tokens + self.positions[: tokens.shape[1]]))
        first: Tensor = self.layers(tokens)[:, 0]
        return first


class _Encoders(OwnActor, RegularizedCritics):
    """Mixin of policies whose actor and critics each have an encoder."""

    net_arch: Any

    def __init__(
        self,
        observation_space: spaces.Space[Any],
        action_space: spaces.Box,
        lr_schedule: Schedule,
        net_arch: list[int] | dict[str, list[int]] | None = None,
        activation_fn: type[nn.Module] = nn.GELU,
        encoder: EncoderName = "mlp",
        width: int = 128,
        n_layers: int = 3,
        attention_dropout: float = 0.1,
        state_first: bool = False,
        target_dropout: bool = True,
        mean_q: bool = True,
        **kwargs: Any,
    ) -> None:
        self.encoder: EncoderName = checked("encoder", encoder, EncoderName)
        self.width: int = checked("width", width, _Even)
        self.n_layers: int = checked("n_layers", n_layers, Count)
        self.attention_dropout: float = checked("attention_dropout", attention_dropout, Share)
        self.state_first: bool = checked("state_first", state_first, bool)
        self._layout = _layout_of(observation_space)
        if net_arch is None:
            net_arch = [] if encoder == "transformer" else [256, 256, 256]
        super().__init__(
            observation_space,
            action_space,
            lr_schedule,
            net_arch=net_arch,
            activation_fn=activation_fn,
            target_dropout=target_dropout,
            mean_q=mean_q,
            **kwargs,
        )

    def _actor_network(self, inputs: int) -> tuple[nn.Module, int]:
        encoder = self._new_encoder(inputs - self._layout.size, heads=2)
        arch, _ = get_actor_critic_arch(self.net_arch)
        layers = create_mlp(encoder.outputs, -1, arch, self.activation_fn)
        return nn.Sequential(encoder, *layers), [encoder.outputs, *arch][-1]

    def _critic_network(self, inputs: int, outputs: int) -> nn.Module:
        encoder = self._new_encoder(
            inputs - self._layout.size,
            heads=1,
            dropout=self._regularization["dropout"],
            attention_dropout=self.attention_dropout,
        )
        return nn.Sequential(encoder, *self._regularized_mlp(encoder.outputs, outputs))

    def _new_encoder(self, n_actions: int, **settings: Any) -> FlatEncoder:
        if self.encoder == "mlp":
            return FlatEncoder(self._layout, n_actions)
        if self.encoder == "conv":
            return ConvEncoder(self._layout, n_actions)
        own = {name: getattr(self, name) for name in ("width", "n_layers", "state_first")}
        return TransformerEncoder(self._layout, n_actions, **own, **settings)

    def _get_constructor_parameters(self) -> dict[str, Any]:
        names = ("encoder", "width", "n_layers", "attention_dropout", "state_first")
        own = {name: getattr(self, name) for name in names}
        return {**super()._get_constructor_parameters(), **own}


class EncoderSACPolicy(_Encoders, RegularizedSACPolicy):
    """SAC's policy with one of RoboVirtuoso's encoders in the actor and in each critic.

    Critics encode the action as part of the state, and are regularised as DroQ's. Table 4's
    networks see ``Lookahead(env, steps=10, fingers=True)``, or 100, and ``PreviousActionReward``.
    The paper does not say where its networks drop out; here the actor does nowhere.

    Args:
        observation_space: A piano environment's, of ``observation="roll"`` or ``"window"``.
        action_space: A ``Box``.
        lr_schedule: Learning rate.
        net_arch: Hidden layers after the encoder; by default three of 256, after a transformer
            none.
        activation_fn: Activation of those, by default GELU, as in the paper.
        encoder: ``"mlp"``, which does not encode; ``"conv"``, which convolves what is due later;
            or ``"transformer"``.
        width: Numbers of a transformer's token, even.
        n_layers: Layers of a transformer.
        attention_dropout: Probability with which a transformer critic drops weights of attention
            while training; by default BERT's.
        state_first: Whether a transformer takes its output where the state is, as in the paper's
            figure 2, or where the current goal is, as in its authors' code.
        **kwargs: As of :class:`RegularizedSACPolicy`; ``target_dropout`` and ``mean_q`` are true by
            default.

    Raises:
        ConfigError: If a setting is wrong, or the observation does not show a goal, or not as far
            ahead as a convolution needs: a multiple of 10 control steps.
    """


class EncoderTD3Policy(_Encoders, RegularizedTD3Policy):
    """TD3's policy with encoders; arguments as of :class:`EncoderSACPolicy`."""


class EncoderTQCPolicy(_Encoders, RegularizedTQCPolicy):
    """TQC's policy with encoders; arguments as of :class:`EncoderSACPolicy`."""


def _layout_of(space: spaces.Space[Any]) -> ObservationLayout:
    """Return the layout of an observation that shows a goal."""
    layout = getattr(space, "layout", None)
    if not isinstance(layout, ObservationLayout):
        raise ConfigError(
            f"The observation space is a {type(space).__name__} without a layout: expected that of "
            "a piano environment, which a wrapper for other environments may hide."
        )
    if "goal" not in layout:
        raise ConfigError(
            f"The observation has {', '.join(layout)}: expected a block 'goal'. Make the "
            "environment with observation='roll' or 'window'."
        )
    return layout
