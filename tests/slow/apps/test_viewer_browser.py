"""The viewer as a person has it: in Chromium, without a screen and without a network."""

import io
import shutil
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

import maira_qp as mq
from maira_qp.apps.arguments.robot_choice import RobotChoice
from maira_qp.apps.viewer.drawing.surroundings import MARGIN
from maira_qp.apps.viewer.session import RESTS
from maira_qp.apps.viewer.start import bent_configuration
from maira_qp.orientation import matrix_from_quaternion
from maira_qp.robots.urdf.writer import urdf_text

pytest.importorskip("viser", reason="the viewer needs viser")
sync_api = pytest.importorskip("playwright.sync_api", reason="the browser is driven by playwright")
CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
pytestmark = [
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium is installed (Debian: apt-get install chromium)"),
    pytest.mark.xdist_group("browser"),  # one browser, in one process
]

FLAGS = [
    "--no-sandbox",
    "--headless=new",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--no-first-run",
]
SIZE = {"width": 960, "height": 480}
"""Of the page [pixels]: small, for the processor draws it."""
PATH = "x,y,z,qw,qx,qy,qz\n0.5,0,0.5,0,1,0,0\n"
"""The beginning of a file of poses."""
PATIENCE = 40.0
"""For what should come at once [s], on a machine that does much else."""


class Tab:
    """A tab of the browser that shows the viewer, and what it complained of."""

    def __init__(self, context, viewer) -> None:
        before = set(viewer.server.get_clients())
        self.viewer, self.page = viewer, context.new_page()
        self.complaints: list[str] = []
        self.strangers: list[str] = []
        self.page.on("console", lambda m: m.type == "error" and self.complaints.append(m.text))
        self.page.on("pageerror", lambda error: self.complaints.append(str(error)))
        self.page.on("request", self._asked)
        self.page.goto(viewer.url)
        self.wait(lambda: set(viewer.server.get_clients()) - before)
        (self.client,) = set(viewer.server.get_clients()) - before
        self.page.get_by_text("condition number").wait_for(timeout=1000 * PATIENCE)

    def _asked(self, request) -> None:
        if not request.url.startswith((self.viewer.url, "data:", "blob:")):
            self.strangers.append(request.url)

    def wait(self, condition: Callable[[], object]) -> None:
        """Waits until something is true, while the browser goes on."""
        end = time.monotonic() + PATIENCE
        while not condition():
            assert time.monotonic() < end, "it did not come true in time"
            self.page.wait_for_timeout(50)

    def open(self, name: str) -> None:
        """One of the panel's tabs."""
        self.page.get_by_role("tab", name=name).click()

    def click(self, name: str, exact: bool = False) -> None:
        """A button."""
        self.page.get_by_role("button", name=name, exact=exact).click()

    def click_at_once(self, *names: str) -> None:
        """Buttons, faster than a person can."""
        self.page.get_by_role("button", name=names[0], exact=True).wait_for(timeout=1000 * PATIENCE)
        self.page.evaluate(
            "names => names.forEach(name => "
            "[...document.querySelectorAll('button')].find(button => button.textContent === name).click())",
            names,
        )

    def unfold(self, name: str) -> None:
        """A folder of the panel that is shut."""
        self.page.get_by_text(name, exact=True).click()
        self.page.wait_for_timeout(500)

    def write(self, index: int, text: str) -> None:
        """Into one of the fields of text or numbers that are seen."""
        field = self.page.locator(".mantine-TextInput-input:visible, .mantine-NumberInput-input:visible").nth(index)
        field.fill(text)
        field.press("Enter")

    def go_home(self) -> None:
        """The arm is put to where it begins, where its target is in sight."""
        q = bent_configuration(self.viewer.current.robot)
        self.viewer.session("home", lambda session: [session.set_joint(i, q[i]) for i in range(len(q))])
        self.wait(lambda: (self.viewer.current.q == q).all())
        self.page.wait_for_timeout(500)

    def on_screen(self, point: np.ndarray) -> np.ndarray:
        """Where a point (3,) [m] is seen (2,) [pixels]: a pinhole, x right, y down, z ahead."""
        camera = self.viewer.server.get_clients()[self.client].camera
        x, y, z = matrix_from_quaternion(camera.wxyz).T @ (point - camera.position)
        focal = 0.5 * self.scene["height"] / np.tan(0.5 * camera.fov)
        return 0.5 * np.array([self.scene["width"], self.scene["height"]]) + focal * np.array([x, y]) / z

    @property
    def scene(self) -> dict[str, float]:
        """Where the scene is in the page: x, y, width and height [pixels]."""
        return self.page.locator("canvas").first.bounding_box()

    def see(self, frames: int) -> None:
        """Waits until the page was drawn so many times: what is under the mouse is found when it is drawn."""
        self.page.evaluate(
            "frames => new Promise(done => { const next = () => frames-- > 0 ? requestAnimationFrame(next) : done();"
            " next(); })",
            frames,
        )

    def drag(self, begin: np.ndarray, end: np.ndarray) -> None:
        """With the mouse, from one place on the screen (2,) to another."""
        self.page.bring_to_front()
        mouse = self.page.mouse
        mouse.move(*begin)
        self.see(4)
        mouse.down()
        self.see(1)
        for share in np.linspace(0, 1, 8):
            mouse.move(*((1 - share) * begin + share * end))
            self.see(1)
        mouse.up()

    def drag_target(self, axis: int, way: float) -> None:
        """The target's gizmo by one of its arrows, so far [m] along it; a grip that missed is tried again."""
        from maira_qp.apps.viewer.drawing.scene import GIZMO

        session, before = self.viewer.current, self.viewer.current.target.translation
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            T = session.target
            grip = T.translation + 0.75 * GIZMO * session.robot.length * T.rotation[:, axis]
            self.drag(self.on_screen(grip), self.on_screen(grip + way * T.rotation[:, axis]))
            self.page.wait_for_timeout(300)
            if np.linalg.norm(session.target.translation - before) > 0.2 * abs(way):
                return
        raise AssertionError("the target cannot be dragged")

    def click_at(self, points: list[np.ndarray], is_heard: Callable[[], bool]) -> None:
        """One after the other of places (3,) in the scene, until a click is heard: others are hidden."""
        for point in points:
            self.page.mouse.move(*self.on_screen(point))
            self.see(4)
            self.page.mouse.click(*self.on_screen(point))
            self.page.wait_for_timeout(500)
            if is_heard():
                return
        raise AssertionError("it cannot be clicked")

    def picture(self) -> np.ndarray:
        """The scene as it is seen (height, width, 3), without the panel beside it."""
        content = self.page.screenshot(clip=self.scene, timeout=1000 * PATIENCE)
        return np.asarray(Image.open(io.BytesIO(content)).convert("RGB")).astype(int)


@pytest.fixture(scope="module")
def context() -> Iterator:
    with sync_api.sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        context = browser.new_context(viewport=SIZE, permissions=["clipboard-read", "clipboard-write"])
        yield context
        context.close()
        browser.close()


@pytest.fixture(scope="module")
def viewer() -> Iterator:
    from maira_qp.apps.viewer.server import Viewer

    viewer = Viewer(RobotChoice(), port=0)
    yield viewer
    viewer.close()


@pytest.fixture(scope="module")
def tab(context, viewer) -> Iterator[Tab]:
    tab = Tab(context, viewer)
    yield tab
    tab.page.close()


@pytest.fixture(autouse=True)
def nothing_is_complained_of(request) -> Iterator[None]:
    """After each test: no error in the page's console, and nothing asked of any other machine."""
    yield
    if "tab" in request.fixturenames:
        tab = request.getfixturevalue("tab")
        assert tab.complaints == []
        assert tab.strangers == []


def test_it_is_served_to_this_machine_alone(viewer):
    assert viewer.url.startswith("http://127.0.0.1:")


def test_the_arm_is_drawn(tab, viewer):
    """Where the arm is seen, there is another picture than that of the scene without it."""
    with_arm = tab.picture()
    arm = viewer.server.scene.get_handle_by_name("/arm")
    arm.visible = False
    tab.wait(lambda: (np.abs(tab.picture() - with_arm).max(axis=2) > 30).sum() > 500)
    changed = np.abs(tab.picture() - with_arm).max(axis=2) > 30
    column, row = tab.on_screen(viewer.current.robot.forward(viewer.current.q, "link2").translation).astype(int)
    assert changed[row - 3 : row + 4, column - 3 : column + 4].all()
    arm.visible = True
    tab.wait(lambda: np.abs(tab.picture() - with_arm).mean() < 0.5)


def test_dragging_the_target_moves_the_joints_until_the_tool_is_there(tab, viewer):
    tab.go_home()
    session = viewer.current
    q, before = session.q, session.target
    tab.drag_target(0, -0.15)
    tab.wait(lambda: np.abs(mq.pose_error(session.robot.forward(session.q), session.target)).max() < 1e-6)
    assert np.abs(session.q - q).max() > 0.02
    way = before.rotation.T @ (session.target.translation - before.translation)
    assert np.abs(way[1:]).max() < 1e-3 < abs(way[0])
    tab.page.get_by_text("REACHED", exact=True).wait_for(timeout=1000 * PATIENCE)


def test_a_target_out_of_reach_is_told_and_comes_back(tab, viewer):
    tab.go_home()
    session = viewer.current
    home = session.target.homogeneous
    for way in (1.0, 2.0, 2.0):
        far = home.copy()
        far[:3, 3] += way
        viewer.session("target", lambda session, far=far: session.move_target(far))
        tab.page.wait_for_timeout(100)
    tab.page.get_by_text("proved out of reach").wait_for(timeout=1000 * PATIENCE)
    viewer.session("target", lambda session: session.move_target(home))
    tab.page.get_by_text("REACHED", exact=True).wait_for(timeout=1000 * PATIENCE)
    tab.wait(lambda: np.abs(mq.pose_error(session.robot.forward(session.q), session.target)).max() < 1e-6)


def test_a_target_is_typed_its_pose_and_q_are_copied_and_it_is_undone(tab, viewer):
    tab.open("Target")
    tab.go_home()
    session = viewer.current
    home, copied = session.target, lambda: tab.page.evaluate("navigator.clipboard.readText()")
    tab.wait(lambda: session.arm.still > RESTS)
    tab.write(0, "900, -600.5, 700")
    tab.wait(lambda: np.abs(session.target.translation - [0.9, -0.6005, 0.7]).max() < 1e-12)
    np.testing.assert_array_equal(session.target.rotation, home.rotation)
    tab.page.get_by_text("REACHED", exact=True).wait_for(timeout=1000 * PATIENCE)
    tab.write(1, "180, 0, 90")
    tab.wait(lambda: np.abs(session.target.rotation - mq.pose(rpy=[np.pi, 0, np.pi / 2]).rotation).max() < 1e-9)
    tab.write(2, "none")
    tab.page.get_by_text("w, x, y, z: 4 numbers, such as 1, 2, 3, 4").first.wait_for(timeout=1000 * PATIENCE)

    def is_copied(button: str, start: str, is_right: Callable[[str], object]) -> bool:
        """What a button copies is right, once the panel shows where the arm has come to rest."""
        tab.click(button)
        tab.page.wait_for_timeout(200)
        return copied().startswith(start) and bool(is_right(copied()))

    def is_pose(text: str) -> bool:
        return np.abs(mq.pose_error(eval(text, {"mq": mq}), session.robot.forward(session.q))).max() < 1e-3

    tab.wait(lambda: is_copied("Copy in Python", "mq.pose([", is_pose))
    tab.page.mouse.click(20, 400)
    tab.page.keyboard.press("o")
    tab.wait(lambda: np.abs(session.target.translation - [0.9, -0.6005, 0.69]).max() < 1e-9)  # along z of the tool
    tab.click("Home")
    tab.wait(lambda: np.abs(session.target.homogeneous - home.homogeneous).max() < 1e-12 and session.arm.still > RESTS)
    tab.click("Undo")
    tab.wait(lambda: np.abs(session.target.homogeneous - home.homogeneous).max() > 0.01)
    tab.go_home()
    tab.open("Joints")
    is_q = lambda text: np.abs(np.array(eval(text)) - session.q).max() < 1e-8  # noqa: E731
    tab.wait(lambda: is_copied("Copy q as a Python list [rad, m]", "[", is_q))


def test_on_a_phone_the_panel_is_below_the_arm(context, viewer):
    """The arm is seen in the upper half; the panel, over the lower one, is as wide as the page."""
    page = context.new_page()
    page.set_viewport_size({"width": 390, "height": 844})
    before = set(viewer.server.get_clients())
    page.goto(viewer.url)
    page.get_by_text("condition number").wait_for(timeout=1000 * PATIENCE)
    (new,) = set(viewer.server.get_clients()) - before
    camera, session = viewer.server.get_clients()[new].camera, viewer.current

    def is_laid_out() -> bool:
        sheet = page.locator(".mantine-Paper-root", has_text="condition number").first.bounding_box()
        if (sheet["x"], sheet["width"]) != (0, 390) or sheet["y"] <= 400:
            return False
        points = [session.robot.forward(session.q, link).translation for link in ("base_link", "link4", "tool0")]
        x, y, z = matrix_from_quaternion(camera.wxyz).T @ (np.array(points) - camera.position).T
        focal = 422 / np.tan(0.5 * camera.fov)
        right, down = focal * x / z, focal * y / z
        return bool((np.abs(right) < 195).all() and (down > -422).all() and (down < sheet["y"] - 422).all())

    end = time.monotonic() + PATIENCE
    while not is_laid_out():
        assert time.monotonic() < end, "the arm is not seen above the panel"
        page.wait_for_timeout(100)
    page.close()


def test_the_switch_and_the_weight_act(tab, viewer):
    tab.open("Solutions")
    tab.page.get_by_label("Redundancy").click()
    tab.page.get_by_role("option", name="Weighted").click()
    tab.wait(lambda: viewer.current.workplace.method == "weighted")
    tab.page.get_by_text("Weight 10^").wait_for(timeout=1000 * PATIENCE)
    weight = tab.page.get_by_role("slider").first
    weight.focus()
    for _ in range(5):
        tab.page.keyboard.press("ArrowRight")
    tab.wait(lambda: viewer.current.workplace.weight > 2e-3)
    tab.page.get_by_label("Redundancy").click()
    tab.page.get_by_role("option", name="Strict").click()
    tab.wait(lambda: viewer.current.workplace.method == "strict")


def test_the_swivel_slider_moves_the_elbow_and_not_the_tool(tab, viewer):
    tab.open("Solutions")
    tab.go_home()
    session = viewer.current
    tab.wait(lambda: session.elbow is not None)
    elbow, tool = session.robot.forward(session.q, "link4").translation, session.robot.forward(session.q)
    slider = tab.page.get_by_role("slider").last
    slider.focus()
    for _ in range(40):
        tab.page.keyboard.press("ArrowRight")
    tab.wait(lambda: np.linalg.norm(session.robot.forward(session.q, "link4").translation - elbow) > 0.05)
    assert np.abs(mq.pose_error(session.robot.forward(session.q), tool)).max() < 1e-6


def test_arrow_keys_on_a_slider_do_not_turn_the_camera(tab, viewer):
    tab.open("Joints")
    tab.go_home()
    session, camera = viewer.current, viewer.server.get_clients()[tab.client].camera
    position, q = camera.position.copy(), session.q
    tab.page.get_by_role("slider").first.focus()
    for key in ("ArrowRight", "ArrowLeft", "ArrowRight"):
        tab.page.keyboard.down(key)
        tab.page.wait_for_timeout(300)
        tab.page.keyboard.up(key)
    tab.wait(lambda: session.q[0] != q[0])
    tab.page.wait_for_timeout(500)
    np.testing.assert_allclose(camera.position, position, atol=1e-9)


def test_with_keep_clear_what_is_converged_is_clear(tab, viewer):
    """A ball on the elbow, the target raised by 50 mm: the arm gets out of it, and is where it is said to be."""
    tab.go_home()
    session = viewer.current
    ball = mq.Sphere(0.1, mq.pose(session.robot.forward(session.q, "link4").translation), name="ball on the elbow")
    viewer.session("ball", lambda session: session.put_obstacle(ball))
    viewer.session("avoid", lambda session: session.avoid(True))
    T = session.target.homogeneous.copy()
    T[2, 3] += 0.05
    viewer.session("target", lambda session: session.move_target(T))
    tab.wait(lambda: np.abs(session.target.homogeneous - T).max() < 1e-9)
    scene = mq.CollisionLimit(obstacles=[ball], self_collision=False).of(session.robot).scene

    def is_clear() -> bool:
        return bool(scene.contacts(session.q, np.inf).distances.min() > MARGIN - 2e-4)

    tab.wait(
        lambda: is_clear() and np.abs(mq.pose_error(session.robot.forward(session.q), session.target)).max() < 1e-6
    )
    tab.page.get_by_text("REACHED", exact=True).wait_for(timeout=1000 * PATIENCE)
    assert is_clear()
    viewer.session("remove", lambda session: [session.remove_obstacles(), session.avoid(False)])
    tab.wait(lambda: not session.workplace.obstacles)


def test_all_solutions_are_shown_and_visited(tab, viewer):
    tab.open("Solutions")
    tab.go_home()
    session = viewer.current
    tab.page.get_by_label("Show all solutions").click()
    tab.page.get_by_text("arcs of solutions").wait_for(timeout=1000 * PATIENCE)
    q = session.q
    tab.click("Go to the next solution")
    tab.wait(lambda: np.abs(session.q - q).max() > 0.3)
    tab.wait(lambda: session.arm.motion is None)
    ghosts = session.tick(0.0).ghosts
    worst = ghosts.q[-1]
    tab.page.get_by_label("Go to", exact=True).click()
    tab.page.get_by_role("option", name=ghosts.names[-1]).click()
    tab.wait(lambda: np.abs(session.q - worst).max() < 1e-9)
    elbows = [session.robot.forward(q, "link4").translation for q in ghosts.q[:-1]]
    tab.click_at(elbows, lambda: np.abs(session.q - worst).max() > 0.1)
    tab.page.get_by_label("Show all solutions").click()
    tab.wait(lambda: not session.shows_ghosts)


def test_a_joint_at_its_limit_is_named(tab, viewer):
    tab.open("Joints")
    tab.write(3, "150")
    tab.wait(lambda: viewer.current.q[3] == viewer.current.robot.upper[3])
    tab.page.get_by_text("joint4 upper").wait_for(timeout=1000 * PATIENCE)


def test_obstacles_are_added_measured_and_removed(tab, viewer):
    tab.open("Obstacles")
    tab.click_at_once("Ball", "Box")
    tab.page.get_by_text("ball 1 - ").wait_for(timeout=1000 * PATIENCE)
    tab.page.get_by_text("box 2 - ").wait_for(timeout=1000 * PATIENCE)
    tab.page.get_by_label("Keep clear of them").click()
    tab.wait(lambda: viewer.current.workplace.is_avoiding)
    tab.page.get_by_label("Keep clear of them").click()
    tab.click("All", exact=True)
    tab.wait(lambda: not viewer.current.workplace.obstacles)


def test_a_motion_is_recorded_played_saved_and_downloaded(tab, viewer, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    session = viewer.current
    tab.open("Path")
    tab.unfold("Recorded motion")
    tab.click("Play")  # nothing yet: the page says so, and goes on
    tab.page.get_by_text("nothing is recorded yet").first.wait_for(timeout=1000 * PATIENCE)
    tab.click("Record")
    tab.wait(lambda: len(session.recording) > 20)
    tab.click("End the recording")
    tab.wait(lambda: not session.is_recording)
    tab.click("Play")
    tab.click("Save where the viewer runs")
    tab.wait(lambda: Path("motion.csv").exists())
    rows = np.genfromtxt("motion.csv", delimiter=",", names=True)
    np.testing.assert_allclose(rows["q_joint1"], session.recording.q[:, 0])
    with tab.page.expect_download(timeout=1000 * PATIENCE) as download:
        tab.click("Download")
    assert Path(download.value.path()).read_bytes() == Path("motion.csv").read_bytes()
    tab.write(-1, "../motion.csv")
    tab.page.wait_for_timeout(500)
    tab.click("Save where the viewer runs")
    tab.page.get_by_text("cannot be the file's name").wait_for(timeout=1000 * PATIENCE)
    assert not Path("../motion.csv").exists()


def test_a_path_is_made_followed_scrubbed_played_explained_and_left(tab, viewer):
    tab.open("Path")
    tab.go_home()
    session, home = viewer.current, viewer.current.target.homogeneous
    tab.click("Follow")  # nothing yet: the page says so, and goes on
    tab.page.get_by_text("there is no path yet").first.wait_for(timeout=1000 * PATIENCE)
    for k, way in enumerate(((0, 0, 0), (0, 0.1, 0))):
        T = home.copy()
        T[:3, 3] += way
        viewer.session("target", lambda session, T=T: session.move_target(T))
        tab.wait(lambda T=T: np.abs(session.target.homogeneous - T).max() < 1e-12)
        tab.click("Add pose")
        tab.wait(lambda k=k: len(session.route.given) == k + 1)
    tab.click("Follow")
    tab.page.get_by_text("Followed whole").wait_for(timeout=1000 * PATIENCE)
    tab.page.get_by_text("pose 0 of 0 to 20: reached").wait_for(timeout=1000 * PATIENCE)
    with_line = tab.picture()
    viewer.server.scene.get_handle_by_name("/path/line").visible = False
    tab.wait(lambda: (np.abs(tab.picture() - with_line).max(axis=2) > 30).sum() > 20)
    slider = tab.page.get_by_role("slider").last
    slider.focus()
    for _ in range(5):
        tab.page.keyboard.press("ArrowRight")
    tab.page.get_by_text("pose 5 of 0 to 20: reached").wait_for(timeout=1000 * PATIENCE)
    np.testing.assert_allclose(session.robot.forward(session.q).translation, home[:3, 3] + [0, 0.025, 0], atol=1e-6)
    tab.page.get_by_role("button", name="Play", exact=True).first.click()
    tab.page.get_by_text("pose 20 of 0 to 20: reached").wait_for(timeout=1000 * PATIENCE)
    tab.go_home()
    tab.page.get_by_text("ON THE PATH").wait_for(state="hidden", timeout=1000 * PATIENCE)

    tab.unfold("Circle or file")
    for content, told in ((PATH + "0.5,nan,0.5,0,1,0,0", "ring.csv, line 3"), (PATH + "2.5,0,0.5,0,1,0,0", "")):
        with tab.page.expect_file_chooser() as chooser:
            tab.click("Upload a path")
        chooser.value.set_files({"name": "ring.csv", "mimeType": "text/csv", "buffer": content.encode()})
        if told:
            tab.page.get_by_text(told).first.wait_for(timeout=1000 * PATIENCE)
            assert session.route.kind == "corners"
    tab.page.get_by_text("ring.csv: 2 poses").wait_for(timeout=1000 * PATIENCE)
    tab.unfold("Circle or file")
    tab.click("Follow")
    tab.page.get_by_text("Fails at pose 1").wait_for(timeout=1000 * PATIENCE)
    tab.click("Next failure")
    tab.page.get_by_text("OFF THE PATH").wait_for(timeout=1000 * PATIENCE)
    tab.click("Why?")
    tab.page.get_by_text("Proved: ").wait_for(timeout=1000 * PATIENCE)
    tab.click("Clear")
    tab.page.get_by_text("no path yet: add").wait_for(timeout=1000 * PATIENCE)
    tab.go_home()


def test_another_robot_is_picked_and_a_wrong_file_is_told(tab, viewer):
    tab.open("Robot")
    tab.unfold("From a file")
    tab.write(0, "nowhere.urdf")
    tab.page.wait_for_timeout(500)
    tab.click("Load the file")
    tab.page.get_by_text("cannot open the robot description").wait_for(timeout=1000 * PATIENCE)
    assert viewer.current.robot.name == "maira"
    with tab.page.expect_file_chooser() as chooser:
        tab.click("Upload a file")
    content = urdf_text(mq.Robot.iiwa14().dh).encode()
    chooser.value.set_files({"name": "../arm.urdf", "mimeType": "text/xml", "buffer": content})
    tab.wait(lambda: viewer.current.robot.name == "iiwa14")
    tab.page.get_by_text("iiwa14 (tool0)").wait_for(timeout=1000 * PATIENCE)
    tab.open("Robot")
    tab.page.get_by_text("7 joints from base_link to tool0").wait_for(timeout=1000 * PATIENCE)
    tab.page.get_by_label("Tip", exact=True).click()
    tab.page.get_by_role("option", name="link5").click()
    tab.wait(lambda: viewer.current.robot.tip == "link5")
    assert viewer.current.robot.name == "iiwa14"
    tab.page.get_by_text("iiwa14 (link5)").wait_for(timeout=1000 * PATIENCE)
    tab.open("Robot")
    tab.page.get_by_text("to link5").wait_for(timeout=1000 * PATIENCE)
    tab.page.get_by_label("Robot", exact=True).click()
    tab.page.get_by_role("option", name="maira").click()
    tab.wait(lambda: viewer.current.robot.name == "maira")


def test_two_tabs_show_the_same_arm_and_either_may_go(context, tab, viewer):
    tab.go_home()
    other = Tab(context, viewer)
    other.drag_target(2, -0.1)
    other.page.close()
    tab.go_home()
    tab.wait(lambda: other.client not in viewer.server.get_clients())
    tab.drag_target(2, -0.1)
    assert other.complaints == []


def test_a_tab_that_comes_back_finds_the_arm_where_it_was(tab, viewer):
    tab.go_home()
    q, clients = viewer.current.q, set(viewer.server.get_clients())
    tab.page.reload()
    tab.wait(lambda: set(viewer.server.get_clients()) - clients)
    (tab.client,) = set(viewer.server.get_clients()) - clients
    tab.page.get_by_text("condition number").wait_for(timeout=1000 * PATIENCE)
    np.testing.assert_array_equal(viewer.current.q, q)
    tab.drag_target(0, -0.1)
