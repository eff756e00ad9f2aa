"""The view from beside a boat: true to scale, at eye level, with a sea that goes on to the horizon.

The camera looks against the storm's waves and goes along with the boat's mean motion. The storm is computed from its
waves at any place, also beyond the area (`RecordedSea.storm`), and its slopes and crests with it; the farther away, the
less is left of waves that are shorter than a few pixels. The long waves are those that were recorded. Water reflects
the sky by Fresnel's law, in Schlick's approximation (doi 10.1111/1467-8659.1330233). Ripples, foam, spray and wake are
patterns at places that waves, wind and boat give them: foam and spray where waves are steep, as in `SeaShading`.
"""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np

from usvauv.env.render import shapes, style
from usvauv.env.render.layout import Layout, Rectangle
from usvauv.env.render.mission import Playback, Series, running_mean
from usvauv.env.render.views.scene import BOAT_AFLOAT, Canvas, PinholeCamera, nearest, turned
from usvauv.env.render.views.sea_surface import FOAM_FROM

LENGTH = 8.0  # m, of a boat whose scenario has none
AWAY = 4.4  # from the camera to the boat, in its lengths
HEIGHT = 0.5  # of the camera above the water at the boat, in its lengths
ANGLE = 0.9  # horizontal angle of view, rad
HORIZON = 0.33  # of the height of the picture, from above
ASIDE = math.radians(38)  # from the direction that waves come from to that in which the camera looks
SOFT = 0.6  # m, in which the camera rises from one height of water to another
SMOOTH = 20.0  # s, over which the camera's way is averaged
NEAREST, FARTHEST = 0.25, 600.0  # of the sea that is shown, in distances to the boat
SAMPLES, ACROSS = 240, 193  # along and across, of the computed sea
HAZE = 700.0  # m, in which all but 1/e of the light is the sky's
DROP = 0.035  # m, radius of a drop as it is drawn
TILE = 256  # texels of a pattern, which repeats

SKY_LOW = np.array(style.colour("#c9d3d6"), np.float32)
SKY_HIGH = np.array(style.colour("#5d7385"), np.float32)
BODY = np.array(style.colour("#0a3242"), np.float32)
CREST = np.array(style.colour("#2f8f93"), np.float32)
FOAM = np.array(style.colour("#eef6f7"), np.float32)
SUN = np.array((-0.45, 0.55, 0.70), np.float32)  # direction to the light behind the clouds: right, ahead, up
WAKE = 9.0  # s, for which a wake is seen


def pattern(seed: int, power: float) -> np.ndarray:
    """Random numbers (TILE, TILE) float32 that repeat, of mean 0 and variance 1, with a spectrum k^−power."""
    random = np.random.default_rng(seed).standard_normal((TILE, TILE))
    k = np.hypot(np.fft.fftfreq(TILE)[:, None], np.fft.fftfreq(TILE)) * TILE
    shaped = np.fft.ifft2(np.fft.fft2(random) * np.where((k > 2) & (k < TILE / 3), k + 1e-9, np.inf) ** -power).real
    return (shaped / shaped.std()).astype(np.float32)


class BoatView:
    """Draws one boat of world 0 of a trace from beside it.

    Attributes:
        length: of the boat, m.
        ahead, across: distances at which the sea is computed, along the camera's direction and to its right, m.
    """

    def __init__(self, play: Playback, box: Rectangle, layout: Layout, boat: int) -> None:
        self._play, self._box, self._layout, self._boat = play, box, layout, boat
        scenario = play.trace.scenario
        self.length = scenario.boat.length or LENGTH
        self._distance = AWAY * self.length
        self._way = Series(running_mean(play.boats.values[:, boat], round(SMOOTH / scenario.mission.step)), smooth=True)
        focal = 0.5 * box.width / math.tan(0.5 * ANGLE)
        storm = play.sea.storm(0.0)
        a, kx, ky, _ = storm.T
        against = math.atan2(-(a * ky).sum(), -(a * kx).sum()) if len(storm) else math.pi / 2
        centre = 0.5 * (box.width - 1), HORIZON * box.height
        self._camera = PinholeCamera(against + ASIDE, self._distance, 0.0, focal, centre)
        # In even intervals of 1/distance, which are even intervals of the picture's rows.
        lowest = focal * HEIGHT * self.length / ((1.0 - HORIZON) * box.height)  # distance of what is lowest in view
        nearest_sea = min(NEAREST * self._distance, 0.7 * lowest)
        self.ahead = 1.0 / np.linspace(1.0 / nearest_sea, 1.0 / (FARTHEST * self._distance), SAMPLES)
        # Across, the denser the nearer the middle: u = c sinh(b n).
        self._dense, self._spread = 0.5 * self._distance / ACROSS, 0.055
        n = np.arange(ACROSS) - ACROSS // 2
        self.across = self._dense / self._spread * np.sinh(self._spread * n)
        self._ray = ((2.0 * np.arange(box.width // 2) + 0.5 - centre[0]) / focal).astype(np.float32)
        sideways = self.ahead[:, None].astype(np.float32) * self._ray
        self._columns = (np.arcsinh(sideways * (self._spread / self._dense)) / self._spread + ACROSS // 2).astype("f4")
        self._lines = np.broadcast_to(np.arange(SAMPLES, dtype=np.float32)[:, None], sideways.shape).copy()
        apart = np.gradient(self.ahead)[:, None]
        k = np.hypot(kx, ky)
        self._left = np.exp(-0.5 * (0.35 * apart * k) ** 2)  # of each wave at each distance
        self._ripples = [pattern(seed, 1.3) for seed in (1, 2)]
        self._patches, self._drops = pattern(3, 1.1), np.random.default_rng(4).uniform(size=(240, 20, 4))
        self._sky = self._clouds()

    def camera(self, t: float) -> PinholeCamera:
        """The camera of a moment; its pixels are those of the box."""
        x, y = aim = self._way.at(t)
        heights = self._height(t, aim - np.linspace(0.0, self._distance, 12)[:, None] * self._camera.forward)
        up = HEIGHT * self.length + float(np.log(np.exp(heights / SOFT).mean())) * SOFT  # about the highest on its way
        return replace(self._camera, height=up, aim=(float(x), float(y)))

    def draw(self, picture: np.ndarray, t: float) -> None:
        """Draw a moment inside the box of a BGR picture."""
        canvas = Canvas(self._box.of(picture), self.camera(t))
        np.copyto(canvas.picture, self._sky)
        away = self._draw_sea(canvas, t)
        self._draw_spray(canvas, t)
        self._draw_boat(canvas, t, away)
        self._write(canvas.picture, t)

    def surface(self, t: float, camera: PinholeCamera) -> np.ndarray:
        """Elevation (m), slopes to the right and ahead, and −∇²η (1/m) at the samples, (SAMPLES, ACROSS, 4) float32."""
        a, kx, ky, phase = self._play.sea.storm(t).T
        east, north = camera.eye
        right, ahead = (np.stack([kx, ky], 1) @ axis for axis in (camera.right, camera.forward))
        turn = np.outer(self.ahead, ahead) + (kx * east + ky * north + phase)
        cos, sin = np.cos(turn) * self._left * a, np.sin(turn) * self._left * a
        beside = np.outer(right, self.across)
        basis = np.concatenate([np.cos(beside), np.sin(beside)]).astype(np.float32)
        rows = ((cos, -sin), (-right * sin, -right * cos), (-ahead * sin, -ahead * cos))
        rows += (((kx**2 + ky**2) * cos, -(kx**2 + ky**2) * sin),)
        left = np.concatenate([np.concatenate(each, axis=1) for each in rows]).astype(np.float32)
        found = (left @ basis).reshape(4, SAMPLES, ACROSS)
        if self._play.sea.surface.size:
            place = camera.eye + self.ahead[:, None, None] * camera.forward + self.across[:, None] * camera.right
            long, water = self._play.sea.beneath(t, place[..., 0], place[..., 1])
            found *= water
            along, beside = np.gradient(long, self.ahead, self.across)
            found[:3] += long, beside, along
        return np.ascontiguousarray(found.transpose(1, 2, 0))

    def _draw_sea(self, canvas: Canvas, t: float) -> np.ndarray:
        """Draw the water; the distance (R, C) that each pixel of the half-size box shows, m, infinite in the sky."""
        picture, camera = canvas
        found = self.surface(t, camera)
        heights = cv2.remap(
            found[..., 0], self._columns, self._lines, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        inverse = (1.0 / self.ahead).astype(np.float32)[:, None]
        rows = (np.float32(camera.height) - heights) * inverse * np.float32(camera.focal) + np.float32(camera.centre[1])
        top = max(int(rows.min()) - 2, 0)
        sample, _ = nearest(rows, top, (picture.shape[0] - top + 1) // 2)
        covered = cv2.inRange(sample, 0.0, SAMPLES - 1.001)  # what is below the nearest sample shows that
        ahead = np.interp(sample, np.arange(SAMPLES), inverse[:, 0]).astype(np.float32)
        ahead = 1.0 / ahead
        beside = ahead * self._ray
        columns = (np.arcsinh(beside * (self._spread / self._dense)) / self._spread + ACROSS // 2).astype(np.float32)
        field = cv2.remap(found, columns, sample.astype(np.float32), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        colours = self._shade(camera, t, field, beside, ahead, top)
        size = 2 * colours.shape[1], 2 * colours.shape[0]
        region = picture[top : top + size[1], : size[0]]
        shown = cv2.resize(covered, size, interpolation=cv2.INTER_LINEAR)[: region.shape[0], : region.shape[1]]
        cv2.threshold(shown, 127, 255, cv2.THRESH_BINARY, shown)
        cv2.copyTo(cv2.resize(colours, size)[: region.shape[0], : region.shape[1]], shown, region)
        away = np.full((picture.shape[0] // 2 + 1, picture.shape[1] // 2), np.inf, np.float32)
        part = away[top // 2 : top // 2 + len(ahead)]
        part[:] = np.where(covered > 0, ahead, np.inf)[: len(part)]
        return away

    def _shade(
        self, camera: PinholeCamera, t: float, field: np.ndarray, beside: np.ndarray, ahead: np.ndarray, top: int
    ) -> np.ndarray:
        """Colours (R, C, 3) of water with elevation, slopes and crests (R, C, 4) at places beside and ahead, m.

        `top` is the row of the picture at which they begin.
        """
        eta, right, forward, bent = cv2.split(field)
        x = beside * np.float32(camera.right[0]) + ahead * np.float32(camera.forward[0]) + np.float32(camera.eye[0])
        y = beside * np.float32(camera.right[1]) + ahead * np.float32(camera.forward[1]) + np.float32(camera.eye[1])
        near = 1.0 / (1.0 + ahead * np.float32(2.5 / self._distance))
        drift = 0.9 * float(self._play.time.at(t)) / self._play.sea.slow
        for number, (scale, going) in enumerate(((14.0, 1.0), (9.0, -0.7))):
            ripple = self._tiled(self._ripples[number], x * scale + drift * going * 10.0, y * scale - drift * 6.0)
            right, forward = right + 0.13 * near * ripple, forward + 0.13 * near * ripple * (1.0 if number else -1.0)
        upright = 1.0 / cv2.sqrt(1.0 + right * right + forward * forward)
        high = np.float32(camera.height) - eta
        long = 1.0 / cv2.sqrt(beside * beside + ahead * ahead + high * high)
        facing = np.clip((right * beside + forward * ahead + high) * upright * long, 0.0, 1.0)
        mirrored = 1.0 - facing
        mirrored = 0.02 + 0.8 * mirrored * mirrored * mirrored * mirrored * mirrored
        rise = np.clip(2.0 * facing * upright - high * long, 0.0, 1.0)[..., None]  # of the reflected ray
        sky = SKY_LOW + (SKY_HIGH - SKY_LOW) * np.sqrt(rise)
        bright = np.clip((SUN[2] - SUN[0] * right - SUN[1] * forward) * upright, 0.0, 1.0)
        through = np.clip(0.22 + 0.13 * eta, 0.0, 1.0)  # light that shines through crests
        lit = (through * (0.25 + 0.9 * bright))[..., None]
        colours = (BODY + (CREST - BODY) * lit) * (1.0 - mirrored[..., None]) + sky * mirrored[..., None]
        patches = self._tiled(self._patches, x * 7.0, y * 7.0)
        crests = np.maximum(eta, 0.0) * np.maximum(bent, 0.0)
        foam = np.clip((crests * cv2.exp(0.6 * patches) - np.float32(0.8 * FOAM_FROM)) * 5.0, 0.0, 0.9)
        foam = np.maximum(foam, self._wake(camera, t, patches, top))[..., None]
        colours += (FOAM - colours) * foam
        haze = cv2.exp(-ahead / np.float32(HAZE))[..., None]
        colours = SKY_LOW + (colours - SKY_LOW) * haze
        return np.clip(colours, 0, 255).astype(np.uint8)

    def _tiled(self, tile: np.ndarray, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """A pattern at texels x and y, which repeats."""
        return cv2.remap(tile, np.mod(x, TILE), np.mod(y, TILE), cv2.INTER_LINEAR, borderMode=cv2.BORDER_WRAP)

    def _wake(self, camera: PinholeCamera, t: float, patches: np.ndarray, top: int) -> np.ndarray:
        """Foam (R, C) around the boat and behind it: the way of the last seconds, the wider and fainter the older."""
        step, place = self._play.trace.scenario.mission.step, self._play.boats.at(t)[self._boat]
        ago = np.linspace(0.0, WAKE, 24)
        past = np.maximum(t - ago * self._play.sea.slow / step, 0.0)
        way = np.array([self._way.at(moment) for moment in past])
        way += (place - way[0]) * np.exp(-ago / 3.0)[:, None]
        along = np.gradient(way, ago, axis=0)
        speed = np.hypot(*along.T)[:, None] + 1e-9
        half = (
            np.column_stack([-along[:, 1], along[:, 0]])
            / speed
            * (0.16 * self.length + 0.22 * ago * speed[:, 0])[:, None]
        )
        sides = np.concatenate([way + half, way - half])
        pixels = camera.pixel(np.column_stack([sides, self._height(t, sides)]))
        left, right = np.split((pixels - (0.5, top + 0.5)) / 2.0, 2)
        mask = np.zeros(patches.shape, np.uint8)
        strength = np.minimum(speed[:, 0] / 2.5, 1.0) * (1.0 - ago / WAKE) * 0.9
        for n in range(len(ago) - 2, -1, -1):
            shapes.fill(mask, np.array([left[n], right[n], right[n + 1], left[n + 1]]), round(255 * strength[n]))
        turn = np.linspace(0.0, 2 * np.pi, 24, endpoint=False)
        ahead = self._axes(t)[0][:2]
        ring = place + self.length * (
            np.outer(0.56 * np.cos(turn) - 0.02, ahead) + np.outer(0.24 * np.sin(turn), (-ahead[1], ahead[0]))
        )
        hull = camera.pixel(np.column_stack([ring, self._height(t, ring)]))
        shapes.fill(mask, (hull - (0.5, top + 0.5)) / 2.0, 150)
        soft = cv2.GaussianBlur(mask, (0, 0), 2.0) / np.float32(255)
        return np.clip(soft * (1.0 + 0.45 * patches), 0.0, 0.9)

    def _axes(self, t: float) -> np.ndarray:
        """Axes of the boat, as `turned`."""
        return turned(float(self._play.boat_headings.at(t)[self._boat]), self._play.floating.at(t)[self._boat, 1:])

    def _height(self, t: float, places: np.ndarray) -> np.ndarray:
        """Elevation (N,) m at places (N, 2), m."""
        a, kx, ky, phase = self._play.sea.storm(t).T
        long, water = 0.0, 1.0
        if self._play.sea.surface.size:
            long, water = (part[:, 0] for part in self._play.sea.beneath(t, places[:, :1], places[:, 1:]))
        return (a * np.cos(places @ np.stack([kx, ky]) + phase)).sum(axis=1) * water + long

    def _draw_boat(self, canvas: Canvas, t: float, away: np.ndarray) -> None:
        """The boat, tilted as the water is, behind crests that are nearer."""
        place = np.append(self._play.boats.at(t)[self._boat], self._play.floating.at(t)[self._boat, 0])
        distance = float(canvas.camera.away(place))
        reach = math.ceil(0.8 * self.length * canvas.camera.focal / distance)
        x, y = np.rint(canvas.camera.pixel(place)).astype(int).tolist()
        box = slice(max(y - reach, 0), max(y + reach, 0)), slice(max(x - reach, 0), max(x + reach, 0))
        before = canvas.picture[box].copy()
        BOAT_AFLOAT.draw(canvas, place, self._axes(t), self.length)
        hidden = cv2.resize(away, canvas.picture.shape[1::-1])[box] < distance - 0.5 * self.length
        canvas.picture[box][hidden] = before[hidden]

    def _draw_spray(self, canvas: Canvas, t: float) -> None:
        """Drops that the wind blows from steep crests near the boat, and those that the bow throws up in them."""
        a, kx, ky, phase = self._play.sea.storm(t).T
        if not len(a):
            return
        k, wind = np.stack([kx, ky]), -canvas.camera.forward
        seconds = float(self._play.time.at(t)) / self._play.sea.slow
        size = 3.0 * self._distance
        middle = canvas.camera.eye + 1.6 * self._distance * canvas.camera.forward
        places = middle + (np.mod(self._drops[:, 0, :2] * size - middle, size) - 0.5 * size)
        turn = places @ k + phase
        height, bent = (a * np.cos(turn)).sum(axis=1), (a * (k**2).sum(axis=0) * np.cos(turn)).sum(axis=1)
        steep = np.maximum(height, 0.0) * np.maximum(bent, 0.0) > 1.1 * FOAM_FROM
        aside, ahead, begin, fast = self._drops[steep].transpose(2, 0, 1)
        share = np.mod(seconds / 1.4 + begin, 1.0)
        blown = share * (2.0 + 6.0 * fast)
        flat = places[steep][:, None] + np.stack([3.0 * aside - 1.5, 3.0 * ahead - 1.5], -1) + blown[..., None] * wind
        up = height[steep][:, None] + 3.0 * share * (1.0 - share) * (0.3 + fast) - 0.1
        drops = np.concatenate([flat, up[..., None]], axis=-1).reshape(-1, 3)
        away = canvas.camera.away(drops)
        pixels, radius = canvas.camera.pixel(drops), np.clip(DROP * canvas.camera.focal / away, 0.8, 3.0)
        for size in (0.8, 1.4, 2.2):
            some = pixels[(away > NEAREST * self._distance) & (radius >= size) & (radius < 1.6 * size)]
            shapes.dots(canvas.picture, some, size * self._layout.unit, np.broadcast_to(FOAM, (len(some), 3)))

    def _clouds(self) -> np.ndarray:
        """The sky down to the bottom of the picture: lighter towards the horizon, with clouds."""
        height, width = self._box.height, self._box.width
        rise = np.clip((HORIZON * height - np.arange(height)) / (HORIZON * height), 0.0, 1.0)[:, None]
        across = (np.arange(width) - 0.5 * width)[None] / width
        far = 1.0 / (rise + 0.08)
        x, y = (part.astype(np.float32) for part in (100.0 * across * far + 90.0, 34.0 * far + 0.0 * across))
        clouds = self._tiled(pattern(5, 1.7), x, y) * np.minimum(3.0 * rise, 1.0)
        sky = SKY_LOW + (SKY_HIGH - SKY_LOW) * np.sqrt(rise)[..., None] + 9.0 * clouds[..., None]
        return np.clip(sky, 0, 255).astype(np.uint8)

    def _write(self, picture: np.ndarray, t: float) -> None:
        """Heave and tilt of the boat, on a dark ground."""
        unit = self._layout.unit
        up, *slope = self._play.floating.at(t)[self._boat].tolist()
        words = f"heave {up:+.1f} m · tilt {math.degrees(math.atan(math.hypot(*slope))):.0f}°".replace("-", "−")
        shapes.badge(picture, words, np.array([130 * unit, picture.shape[0] - 24 * unit]), 16 * unit, style.BOAT)
