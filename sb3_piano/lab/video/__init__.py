"""Fingering from video: which finger a filmed pianist used for each note of a score.

Five steps, as in section 6.4 of the curriculum-strategies report: find the keyboard in the picture
(``keyboard``), read the hands' landmarks (``landmarks``), align the sound with the score
(``alignment``), choose a finger for each note (``fingers``), and show doubtful notes (``page``).
"""
