"""From a line drawn on a picture of a stage to an outline in the stage's projection frame. No ROS."""
from dataclasses import dataclass

from cortshift_tracking.console.worker import DeskError

LEAST_AREA = 0.00005   # m^2: less is a slip of the hand; a burr hole of 14 mm is three times as large


def area_of(corners):
    """What a closed line encloses."""
    return 0.5 * abs(sum(x * v - u * y for (x, y), (u, v) in zip(corners, corners[1:] + corners[:1])))


@dataclass(frozen=True)
class Grid:
    """The projection grid of a stage; its picture shows the last row at the top and may have a legend below the grid."""
    width: int
    height: int
    resolution: float  # m

    def outline(self, line):
        """Corners [m] of a line of points (x, y) in widths of the picture, from its upper left corner. DeskError for too little."""
        corners = [self._corner(*point) for point in line]
        if area_of(corners) < LEAST_AREA:
            raise DeskError('the line encloses hardly anything; draw once around the brain')
        return corners

    def _corner(self, across, down):
        column = min(max(across * self.width - 0.5, 0), self.width - 1)
        row = min(max(self.height - 0.5 - down * self.width, 0), self.height - 1)
        return column * self.resolution, row * self.resolution
