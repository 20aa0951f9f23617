"""Captions on pictures."""

import numpy as np

from sb3_piano.viewing.caption import write_caption


def written(title, f1=None, shape=(480, 854, 3)):
    picture = np.zeros(shape, dtype=np.uint8)
    write_caption(picture, title, f1)
    return picture


def columns(picture):
    """Return the columns in which something is written."""
    return np.flatnonzero(picture.any(axis=(0, 2)))


def test_the_title_is_on_the_left_the_f1_on_the_right_and_the_rest_as_it_was():
    title = columns(written("Für Elise"))
    assert 5 < title.min() < title.max() < 427
    both = columns(written("Für Elise", 0.93))
    assert both.max() > 800
    assert (written("Für Elise", 0.931) == written("Für Elise", 0.929)).all()
    assert (written("Für Elise", 0.93) != written("Für Elise", 0.91)).any()
    assert not written("Für Elise", 0.93)[60:].any()


def test_a_long_title_is_shortened_to_half_of_the_width_and_what_does_not_fit_is_left_out():
    long = columns(written("Sonata quasi una fantasia " * 5))
    assert 300 < long.max() < 450
    assert not written("Für Elise", shape=(480, 16, 3)).any()
    assert not written("Für Elise", 0.93, shape=(120, 200, 3)).any()


def test_letters_of_other_languages_are_drawn_and_not_replaced():
    shapes = {written(letter)[:60, :60].tobytes() for letter in "üřžçñß\u0e01"}
    assert len(shapes) == 7


def test_the_legend_is_at_the_foot_and_the_lamp_of_the_pedal_lights_up():
    up, down = (np.zeros((480, 854, 3), dtype=np.uint8) for _ in range(2))
    write_caption(up, "", None, pedal=False)
    write_caption(down, "", None, pedal=True)
    assert not up[:440].any()
    assert len(columns(up)) > 500
    lamp = np.argwhere((up != down).any(axis=2))
    assert len(lamp) > 50
    assert lamp[:, 1].min() > 750
