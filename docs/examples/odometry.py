"""The way around a square of 3 m by wheel speeds, for careful_square.py and naive_square.py."""
import math

CORNERS = [(3, 0), (3, 3), (0, 3), (0, 0)]  # m
AHEAD, TURN, CORRECTION = 357, 500, 200  # 0.1 %; for each radian off course
METRES_PER_S = 2 * math.pi * 0.25 / 28.3 / 60  # for 1 r/min of the motor: wheels of 0.25 m, gear 28.3
WIDTH = 1.025  # m; wider than the vehicle, for its wheels slip sideways in turns


class Way:
    def __init__(self):
        self.x = self.y = self.heading = 0.0
        self.speeds = 0.0, 0.0  # m/s, right and left
        self.corners = list(CORNERS)
        self.measured = None

    def measure(self, now, *rpm):
        """Integrates the speeds that the module reports over the time since its last report."""
        speeds = [own * METRES_PER_S for own in rpm]
        time = now - self.measured if self.measured else 0.0
        right, left = ((old + new) / 2 * time for old, new in zip(self.speeds, speeds))
        self.heading += (right - left) / WIDTH / 2
        self.x += (right + left) / 2 * math.cos(self.heading)
        self.y += (right + left) / 2 * math.sin(self.heading)
        self.heading += (right - left) / WIDTH / 2
        self.speeds, self.measured = speeds, now

    def duties(self):
        """What to ask of the right and the left motor; nothing at the end of the way."""
        while self.corners:
            x, y = self.corners[0][0] - self.x, self.corners[0][1] - self.y
            if math.hypot(x, y) > 0.2:
                off = math.remainder(math.atan2(y, x) - self.heading, 2 * math.pi)
                if abs(off) > 0.3:
                    return (TURN, -TURN) if off > 0 else (-TURN, TURN)
                return round(AHEAD + CORRECTION * off), round(AHEAD - CORRECTION * off)
            del self.corners[0]
        return None
