"""Colours of the pictures: one per stage, told apart on grey MR and by colour-blind readers."""

STAGE_COLOURS = ('#ffd500', '#ff4f3f', '#35c2ff', '#5fe35f', '#ff7fe5', '#ff9d2e', '#b8a4ff', '#00d9b0')


def stage_colour(index):
    return STAGE_COLOURS[index % len(STAGE_COLOURS)]
