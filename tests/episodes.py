"""Episodes as players play them."""


def play_episode(env, player):
    """Return the final info of an episode."""
    observation, _ = env.reset(seed=0)
    state, over, info = None, False, {}
    while not over:
        action, state = player.predict(observation, state)
        observation, _, terminated, truncated, info = env.step(action)
        over = terminated or truncated
    return info
