"""RoboVirtuoso's encoders: their sizes, what they see, and where they drop out."""

import gymnasium as gym
import pytest
import torch
from gymnasium import spaces
from yaml_rows import Tables

from sb3_piano.envs import ObservationBlock, ObservationLayout, ObservationSpace
from sb3_piano.exceptions import ConfigError
from sb3_piano.policies import EncoderSACPolicy
from sb3_piano.policies.encoders import ConvEncoder, FlatEncoder, TransformerEncoder
from sb3_piano.wrappers import Lookahead, PreviousActionReward

tables = Tables(__file__)

N_ACTIONS = 39


def layout(ahead=10, keys=89, state=181, fingers=("fingering", "lookahead_fingering")):
    shapes = {
        "goal": (ahead + 1, keys),
        "fingering": (10,),
        "state": (state,),
        "lookahead_fingering": (ahead + 1, 10),
    }
    return ObservationLayout(
        ObservationBlock(name=name, shape=shape, unit="1", meaning="")
        for name, shape in shapes.items()
        if name in ("goal", "state", *fingers)
    )


def make(space, **kwargs):
    actions = spaces.Box(-1.0, 1.0, (N_ACTIONS,))
    return EncoderSACPolicy(space, actions, lambda _: 1e-3, **kwargs)


def parameters(module):
    return sum(p.numel() for p in module.parameters())


@tables("encoder, ahead, wanted")
def test_actors_have_as_many_parameters_as_table_4_says(encoder, ahead, wanted):
    policy = make(ObservationSpace(layout(ahead)), encoder=encoder)
    assert parameters(policy.actor) == wanted


@pytest.mark.parametrize(
    ("encoder", "wanted"), [("mlp", 475_470), ("conv", 327_683), ("transformer", 833_102)]
)
def test_in_the_environment_they_lack_the_six_positions_of_hands(encoder, wanted):
    env = gym.make("RoboPianist-debug-CMajorScaleOneHand-v0", reduced_action_space=True)
    env = PreviousActionReward(Lookahead(env, steps=10, fingers=True))
    assert parameters(make(env.observation_space, encoder=encoder).actor) == wanted


def test_heads_width_and_layers_of_a_transformer_are_as_asked():
    policy = make(ObservationSpace(layout()), encoder="transformer", width=64, n_layers=2)
    for network, heads in ((policy.actor.latent_pi, 2), (policy.critic.q_networks[0], 1)):
        assert network[0].positions.shape[1] == 64
        assert [layer.linear1.out_features for layer in network[0].layers] == [256, 256]
        assert [layer.self_attn.num_heads for layer in network[0].layers] == [heads] * 2
    again = EncoderSACPolicy(**policy._get_constructor_parameters())
    again.load_state_dict(policy.state_dict())


def test_the_last_layer_says_of_the_first_token_what_torchs_does():
    encoder = TransformerEncoder(layout(20, keys=2, state=3, fingers=()), 0, heads=2)
    tokens = torch.rand(4, 3, 128)
    last = encoder.layers[-1]
    with torch.no_grad():
        whole = torch.nn.TransformerEncoderLayer.forward(last, tokens)
        torch.testing.assert_close(last(tokens), whole[:, :1])


def test_labels_that_are_there_twice_are_seen_once_and_without_those_ahead_the_current_ones():
    encoder = FlatEncoder(layout(10, keys=3, state=4), n_actions=2)
    inputs = torch.arange(1.0, 1 + 33 + 10 + 4 + 110 + 2)[None]
    goal, labels, state = inputs[:, :33], inputs[:, 47:157], inputs[:, 43:47]
    wanted = torch.cat([goal, labels, state, inputs[:, 157:]], dim=1)
    torch.testing.assert_close(encoder(inputs), wanted)
    encoder = ConvEncoder(layout(10, keys=3, state=4, fingers=("fingering",)), n_actions=0)
    assert encoder(torch.rand(2, 33 + 10 + 4)).shape == (2, 3 + 10 + 3 + 4)


def test_a_convolution_covers_ten_steps_to_come_and_not_the_current_one():
    encoder = ConvEncoder(layout(20, keys=2, state=1, fingers=()), n_actions=0)
    (convolution,) = encoder.convolutions
    torch.nn.init.ones_(convolution.weight)
    torch.nn.init.zeros_(convolution.bias)
    inputs = torch.rand(3, 43)
    goal = inputs[:, :42].reshape(3, 21, 2)
    soon, late = goal[:, 1:11].sum(dim=(1, 2)), goal[:, 11:].sum(dim=(1, 2))
    wanted = torch.stack([goal[:, 0, 0], goal[:, 0, 1], soon, late, soon, late, inputs[:, 42]])
    found = encoder(inputs)[:, [0, 1, 2, 4, 3, 5, 6]].T
    torch.testing.assert_close(found, wanted)


@pytest.mark.parametrize("state_first", [False, True])
def test_a_transformer_takes_its_output_at_the_first_token(state_first):
    encoder = TransformerEncoder(
        layout(10, keys=2, state=3, fingers=()), 0, heads=1, state_first=state_first
    )
    encoder.layers = torch.nn.Sequential()  # its tokens are its outputs
    inputs = torch.rand(4, 25)
    first = encoder.state(inputs[:, 22:]) if state_first else encoder.now[0](inputs[:, :2])
    torch.testing.assert_close(encoder(inputs), encoder.norm(first + encoder.positions[0]))


@pytest.mark.parametrize("encoder", ["mlp", "conv", "transformer"])
def test_every_number_of_observation_and_action_counts(encoder):
    policy = make(ObservationSpace(layout(10, keys=4, state=5, fingers=())), encoder=encoder)
    inputs = torch.rand(6, 49 + N_ACTIONS, requires_grad=True)
    policy.set_training_mode(False)
    observations, actions = inputs[:, :49], inputs[:, 49:]
    value = sum(network(inputs) for network in policy.critic.q_networks).sum()
    assert (torch.autograd.grad(value, inputs)[0] != 0).all()
    changed = policy.critic(observations, -actions)[0]
    assert (changed != policy.critic(observations, actions)[0]).all()


@pytest.mark.parametrize("dropouts", [(0.5, 0.0), (0.0, 0.5)])
def test_transformer_critics_and_targets_drop_out_while_training_and_actors_never(dropouts):
    space = ObservationSpace(layout(10, keys=4, state=5))
    policy = make(space, encoder="transformer", dropout=dropouts[0], attention_dropout=dropouts[1])
    observations = torch.rand(8, space.shape[0])
    actions = torch.rand(8, N_ACTIONS)
    for training in (True, False):
        policy.set_training_mode(training)
        for critic in (policy.critic, policy.critic_target):
            with torch.no_grad():
                first, second = (critic(observations, actions)[0] for _ in range(2))
            assert torch.equal(first, second) != training
        first, second = (policy.actor(observations, deterministic=True) for _ in range(2))
        assert torch.equal(first, second)


@tables("ahead, kwargs, message")
def test_settings_that_do_not_fit_are_refused(ahead, kwargs, message):
    with pytest.raises(ConfigError, match=message):
        make(ObservationSpace(layout(ahead)), **kwargs)
    with pytest.raises(ConfigError, match="is a Box without a layout: expected that of a piano"):
        make(spaces.Box(0, 1, (7,)))
    with pytest.raises(ConfigError, match="has state: expected a block 'goal'"):
        make(ObservationSpace(ObservationLayout([layout()["state"]])))
