"""Does stock SAC learn a scale for two hands from nothing, in a minute and a half of one core?

It is told by F1, beside that of hands that rest: a return also grows by what rests earn. With the
preset's own 480,000 steps, twenty minutes, nearly all of the piece is learnt (docs/learning.md).
"""

from sb3_piano.training import evaluate, load_config, train

ENV_ID = "RoboPianist-debug-CMajorScaleTwoHands-v0"
STEPS = 12_000  # of hands, of which there are two


def main() -> None:
    config = load_config("sac", ENV_ID, "fast", n_timesteps=STEPS, seed=0)
    done = train(config, runs_dir="runs")
    found = evaluate(done.folder.path)
    assert found.baseline is not None, "a piano has resting hands to compare with"
    learnt, resting = (metrics["f1"] for metrics in (found.mean, found.baseline))
    print(f"F1 after {done.num_timesteps} steps {learnt:.2f}, of resting hands {resting:.2f}")


if __name__ == "__main__":
    main()
