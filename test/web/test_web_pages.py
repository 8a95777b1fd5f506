"""Pages of a live simulator, in a real browser."""

from __future__ import annotations

import threading

import numpy as np
import pytest
from web.web_chromium import DEADLINE

from cube_sim.physics.world import turned_by


def page_of(chromium, served, position=(-4.5, 2.5, 2.9), look_at=(2.5, 0.0, 0.7)):
    """Open a page that looks from there, and wait until it is connected and does."""
    place = ','.join(map(str, position))
    target = ','.join(map(str, look_at))
    page = chromium.open(
        f'{served.url}/?initialCameraPosition={place}&initialCameraLookAt={target}'
    )
    page.wait_for("document.querySelector('canvas') && document.body.innerText.includes('cubes')")
    served.wait_for_camera(lambda at: np.allclose(at, position, atol=1e-3))
    return page


def space(page):
    page.press(' ', 'Space', 32)


def test_two_pages_throw_from_where_each_of_them_looks(ros, sim, live, chromium):
    node = sim(start_paused=True)
    throws = ros.listen('throws')
    served = live()
    views = [((0.0, 0.0, 3.0), (5.0, 0.0, 3.0)), ((4.0, 6.0, 5.0), (4.0, 0.0, 2.0))]
    pages = [page_of(chromium, served, *view) for view in views]
    turns = [0, 1, 1, 0]
    for count, turn in enumerate(turns, 1):
        space(pages[turn])
        throws.wait_for_count(count)
    for turn, throw in zip(turns, throws.messages, strict=True):
        position, look_at = map(np.array, views[turn])
        pose = throw.pose.pose
        at = [pose.position.x, pose.position.y, pose.position.z]
        o = pose.orientation
        turn_of = (o.x, o.y, o.z, o.w)
        ahead = (look_at - position) / np.linalg.norm(look_at - position)
        assert at == pytest.approx(position, abs=1e-3)
        assert turned_by(turn_of, (1, 0, 0)) == pytest.approx(ahead, abs=1e-3)
        assert turned_by(turn_of, (0, 1, 0))[2] == pytest.approx(0.0, abs=1e-3)
    assert len(node.simulation.world) == len(turns)
    assert not [error for page in pages for error in page.errors]


def test_pages_that_throw_at_the_same_time_do_not_mix_their_cameras(ros, sim):
    """Without browsers: many throws at once through one Thrower."""
    from cube_sim.remote import SimulatorLink
    from cube_sim.web.axes import same_pose
    from cube_sim.web.thrower import Thrower

    sim(start_paused=True)
    throws = ros.listen('throws')
    link = SimulatorLink('/cube_sim', name='thrower', context=ros.context)
    thrower = Thrower(link)
    present, done = threading.Event(), threading.Semaphore(0)
    link.on_change = lambda: link.present and present.set()
    link.on_camera = thrower.camera_is_at
    link.start()
    thrower.start()
    assert present.wait(20.0)
    rng = np.random.default_rng(0)
    turns = rng.normal(size=(40, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    poses = np.hstack([rng.uniform(1, 5, (40, 3)), turns])
    answers = []
    pages = [
        threading.Thread(
            target=lambda half: [
                thrower.throw(pose, lambda answer: (answers.append(answer), done.release()))
                for pose in half
            ],
            args=[half],
        )
        for half in (poses[:20], poses[20:])
    ]
    for page in pages:
        page.start()
    for _ in poses:
        assert done.acquire(timeout=20.0)
    for page in pages:
        page.join()
    thrower.close()
    link.close()
    assert all(answer.success for answer in answers)
    came = throws.wait_for_count(len(poses))
    thrown = [
        np.array([p.position.x, p.position.y, p.position.z])
        for p in (message.pose.pose for message in came)
    ]
    assert sorted(map(tuple, thrown)) == sorted(map(tuple, poses[:, :3]))
    for message in came:
        p, o = message.pose.pose.position, message.pose.pose.orientation
        pose = np.array([p.x, p.y, p.z, o.x, o.y, o.z, o.w])
        assert any(same_pose(pose, wanted) for wanted in poses)


def test_keys_switch_the_model_pause_and_reset_and_the_panel_follows(ros, sim, live, chromium):
    node = sim(physics_model='simple', publish_rate=10.0)
    served = live()
    settings = ros.listen('settings')
    page = page_of(chromium, served)
    space(page)
    page.wait_for("document.body.innerText.includes('1 cubes')")
    page.press('Tab', 'Tab', 9)
    settings.wait_for(lambda message: 'impulse' in str(message.changed_parameters))
    page.wait_for("[...document.querySelectorAll('input')].some(i => i.value === 'impulse')")
    page.press('p', 'KeyP', 80)
    page.wait_for("document.body.innerText.includes('paused')")
    assert node.runner.paused
    page.press('r', 'KeyR', 82)
    page.wait_for("document.body.innerText.includes('0 cubes')")
    assert len(node.simulation.world) == 0
    # What others set shows too.
    assert ros.set('restitution', 0.83).successful
    page.wait_for("[...document.querySelectorAll('input')].some(i => i.value === '0.83')")
    assert served.live.frames > 0
    assert not page.errors


def test_a_page_shows_contacts_while_it_is_asked_to(ros, sim, live, chromium):
    node = sim(physics_model='contact', sleep=False, publish_rate=10.0, start_paused=True)
    for level in range(3):
        node.simulation.world.throw((2.0, 0.0, 0.25 + 0.5 * level), (0.0, 0.0, 0.0, 1.0))
    ros.do('pause', False)
    served = live()
    shown = served.watch_contacts()
    page = page_of(chromium, served)
    page.press('c', 'KeyC', 67)
    while (count := shown.get(timeout=DEADLINE)) != 12:
        assert count == 0  # the cubes have just come
    page.wait_for("[...document.querySelectorAll('input[type=checkbox]')].some(i => i.checked)")
    page.press('c', 'KeyC', 67)
    while shown.get(timeout=DEADLINE) != 0:
        pass
    assert not page.errors


def test_a_held_key_flies_by_its_place_on_the_keyboard(ros, sim, live, chromium):
    """The key right of Tab is Z on a French keyboard, and flies forward all the same."""
    sim(start_paused=True)
    throws = ros.listen('throws')
    served = live()
    page = page_of(chromium, served, (0.0, 0.0, 2.0), (5.0, 0.0, 2.0))
    page.key('keyDown', 'z', 'KeyW', 90)
    served.wait_for_camera(lambda at: at[0] > 0.01)
    page.key('keyUp', 'z', 'KeyW', 90)
    space(page)
    place = throws.wait_for_count(1)[0].pose.pose.position
    assert place.x > 0.01
    assert (place.y, place.z) == pytest.approx((0.0, 2.0), abs=1e-3)


def test_a_page_says_when_the_simulator_goes_and_finds_the_next_one(sim, live, chromium):
    served = live()
    page = page_of_absent(chromium, served.url)
    sim(physics_model='impulse')
    page.wait_for("document.body.innerText.includes('0 cubes')")
    page.wait_for("[...document.querySelectorAll('input')].some(i => i.value === 'impulse')")


def page_of_absent(chromium, url):
    page = chromium.open(url)
    page.wait_for("document.body.innerText.includes('No simulator answers on /cube_sim')")
    return page
