"""How does another robot hand play? As a folder with its MJCF and the roles of its parts."""

from pathlib import Path

from sb3_piano.envs import PianoEnv
from sb3_piano.players import make_player
from sb3_piano.players.rollout import rollout

# Four fingers, 16 joints, no wrist: leap_hand/hand.yml tells the planner all that it needs.
LEAP = Path(__file__).parent / "leap_hand"


def main() -> None:
    for hand in ("shadow", LEAP):
        env = PianoEnv("scale-CMajor", hand=hand, fingering="robot", hands_in_scene="right")
        take = next(rollout(make_player("planned", env), env))
        fingers = sorted({note.finger for note in take.score.notes})
        print(
            f"{env.scene.hand.title}: {env.action_space.shape[0]} actions, fingers {fingers}, "
            f"F1 {take.metrics['f1']:.3f}, onset F1 {take.metrics['onset_f1']:.3f}"
        )


if __name__ == "__main__":
    main()
