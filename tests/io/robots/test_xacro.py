"""Xacro files are programs: refused without trust, guarded with it."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from pathlib import Path as FilePath

import pytest

import armcontour as ac
from armcontour._xacro.expanding import expand_xacro
from armcontour._xacro.expressions import OPERATIONS, Refused, compile_expression

pytest.importorskip("xacro")

HEAD = '<robot name="r" xmlns:xacro="http://www.ros.org/wiki/xacro">'
ARM = (
    '<link name="base"/><link name="hand"/><joint name="turn" type="revolute">'
    '<parent link="base"/><child link="hand"/>'
    '<limit lower="-1" upper="1" velocity="2" effort="3"/></joint>'
)
# Three programs that touch a file; each gets past xacro's own check of names.
ESCAPES = {
    "lambda and globals": "(lambda f: f.__globals__['os'].system('touch PWNED'))(xacro.load_yaml)",
    "lambda and subclasses": (
        "(lambda: [c for c in ().__class__.__base__.__subclasses__() if c.__name__ == "
        "'_wrap_close'][0].__init__.__globals__['system']('touch PWNED'))()"
    ),
    "comprehension and subclasses": (
        "[c.__init__.__globals__['system']('touch PWNED') for c in "
        "().__class__.__base__.__subclasses__() if c.__name__ == '_wrap_close']"
    ),
}
ENDLESS = (
    "".join(
        f'<xacro:macro name="m{i}"><xacro:m{i + 1}/><xacro:m{i + 1}/></xacro:macro>'
        for i in range(60)
    )
    + '<xacro:macro name="m60"><link name="x"/></xacro:macro><xacro:m0/>'
)


def write(folder: FilePath, body: str, name: str = "robot.xacro") -> FilePath:
    file = folder / name
    file.write_text(f"{HEAD}{body}</robot>")
    return file


def load(file: FilePath) -> ac.Arm:
    return ac.load_arm(file, trust_xacro=True)


def link(expression: str) -> str:
    escaped = expression.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return f'<link name="{escaped}"/>'


def test_a_trusted_file_becomes_an_arm(tmp_path):
    (tmp_path / "sizes.yaml").write_text("reach: 0.25\nrange: {upper: !degrees 90}\n")
    write(tmp_path, '<xacro:macro name="arm" params="upper">' + ARM + "</xacro:macro>", "arm.xacro")
    body = (
        '<xacro:include filename="arm.xacro"/>'
        '<xacro:property name="sizes" value="${xacro.load_yaml(\'sizes.yaml\')}"/>'
        '<xacro:arm upper="${sizes.range.upper}"/><link name="tip"/>'
        '<joint name="end" type="fixed"><parent link="hand"/><child link="tip"/>'
        '<origin xyz="${sizes.reach * 2**2} $(eval 1 + 1) ${sin(pi / 2) % 2}"/></joint>'
    )
    (tmp_path / "arm.xacro").write_text(
        (tmp_path / "arm.xacro").read_text().replace('upper="1"', 'upper="${upper}"')
    )
    arm = load(write(tmp_path, body))
    assert arm.limits.joint_upper == pytest.approx([1.5707963])
    assert arm.forward([0.0]) == pytest.approx([1.0, 2.0, 1.0])


@pytest.mark.parametrize("program", ESCAPES.values(), ids=ESCAPES)
def test_programs_do_not_run(program, tmp_path, monkeypatch, refuses):
    monkeypatch.chdir(tmp_path)
    value = program.replace("<", "&lt;")
    file = write(tmp_path, f'<xacro:property name="p" value="${{{value}}}"/>{link("x${p}")}')
    refuses(
        lambda: ac.load_arm(file),
        ac.InvalidInput,
        "robot.xacro",
        "a xacro file is a program that can run anything",
        "--trust-xacro",
    )
    refuses(lambda: load(file), ac.InvalidInput, "robot.xacro", "which is refused")
    assert os.listdir(tmp_path) == ["robot.xacro"]


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (link("${xacro.load_yaml('/etc/passwd')}"), ("'/etc/passwd'", "outside of the folder")),
        (link("${xacro.load_yaml('../secret.yaml')}"), ("secret.yaml", "outside of the folder")),
        (link("${xacro.load_yaml('link.yaml')}"), ("link.yaml", "outside of the folder")),
        ('<xacro:include filename="linked/secret.xacro"/>', ("outside of the folder",)),
        ('<xacro:include filename="../*.xacro"/>', ("outside of the folder",)),
        (link("$(env PATH)"), ("variable 'PATH'", "environment is not read")),
        (link("$(optenv PATH none)"), ("variable 'PATH'", "environment is not read")),
        # The reader of `$(...)` sees no parenthesis in `\x29`.
        (link(r"$(eval env('PATH'${'\x29'})"), ("variable 'PATH'",)),
        (link(r"$(eval open('/etc/passwd'${'\x29'})"), ("name 'open' is not defined",)),
        (link("$(find ../../etc)"), ("not the name of a package",)),
        (link("${9**9**9}"), ("more than 4096 bits",)),
        (link("$(eval 9**9**9)"), ("more than 4096 bits",)),
        (link("${'a' * 10**9}"), ("more than 100000 items",)),
        (link("${list(python.range(10**30))}"), ("more than 100000 items",)),
        (link("${math.factorial(10**7)}"), ("more than 4096 bits",)),
        (
            '<xacro:macro name="a" params="__times"><link name="${[1] * 10**9}"/></xacro:macro>'
            '<xacro:a __times="${max}"/>',
            ("more than 100000 items",),
        ),
        (link("${math.prod(['a'], start=10**9)}"), ("prod", "no bound")),
        (link(r"$(eval comb(10**6, 10**5${'\x29'})"), ("comb", "no bound")),
        (link("${python.vars(xacro)}"), ("'vars' is not defined",)),
        (link("${python.type(1)}"), ("'type' is not defined",)),
        ('<xacro:macro name="a"><xacro:a/></xacro:macro><xacro:a/>', ("macros", "100 deep")),
        ('<xacro:include filename="robot.xacro"/>', ("include one another", "100 deep")),
        (
            '<xacro:property name="a0" value="aaaaaaaaaa"/>'
            + "".join(
                f'<xacro:property name="a{i}" value="${{a{i - 1}}}${{a{i - 1}}}"/>'
                for i in range(1, 40)
            )
            + link("${a39}"),
            ("a text of more than 1000000 characters",),
        ),
        (link("${" + "-" * 9000 + "1}"), ("nested too deeply",)),
        (link("${lost}"), ("cannot be expanded by xacro", "'lost' is not defined")),
        ('<xacro:include filename="none.xacro"/>', ("none.xacro", "No such file")),
    ],
)
def test_what_a_trusted_file_must_not_do(body, words, tmp_path, refuses):
    folder = tmp_path / "robot"
    folder.mkdir()
    for name in ("secret.yaml", "secret.xacro"):
        (tmp_path / name).write_text("<robot/>")
    (folder / "link.yaml").symlink_to(tmp_path / "secret.yaml")
    (folder / "linked").symlink_to(tmp_path)
    file = write(folder, body)
    refuses(lambda: load(file), ac.InvalidInput, "robot.xacro", *words)


def test_modules_beside_the_file_are_not_imported(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    for name in ("xacro", "yaml", "json", "armcontour"):
        (tmp_path / f"{name}.py").write_text("open('PWNED', 'w')")
    assert load(write(tmp_path, ARM)).dof == 1
    assert not (tmp_path / "PWNED").exists()


def test_pipes_and_devices_are_not_read(tmp_path, refuses):
    if not hasattr(os, "mkfifo"):
        pytest.skip("needs pipes with names")
    os.mkfifo(tmp_path / "pipe.yaml")
    file = write(tmp_path, link("${xacro.load_yaml('pipe.yaml')}"))
    refuses(lambda: load(file), ac.InvalidInput, "pipe.yaml is not a regular file")


def test_files_of_packages_that_are_found_are_read(tmp_path, monkeypatch, refuses):
    index, share = tmp_path / "index", tmp_path / "share"
    for folder in (index / "ament_index_python", share / "arms", tmp_path / "robot"):
        folder.mkdir(parents=True)
    (index / "ament_index_python" / "__init__.py").write_text("")
    (index / "ament_index_python" / "packages.py").write_text(
        f"def get_package_share_directory(name):\n    return {str(share)!r} + '/' + name\n"
    )
    monkeypatch.syspath_prepend(index)
    write(share / "arms", ARM, "arm.xacro")
    include = '<xacro:include filename="$(find arms)/{}arm.xacro"/>'
    assert load(write(tmp_path / "robot", include.format(""))).dof == 1
    write(share, ARM, "arm.xacro")
    refuses(
        lambda: load(write(tmp_path / "robot", include.format("../"))),
        ac.InvalidInput,
        "outside of the folder",
    )
    # Without that package, its folder is outside like any other.
    refuses(
        lambda: load(write(tmp_path / "robot", include.replace("$(find arms)", f"{share}/arms"))),
        ac.InvalidInput,
        "outside of the folder",
    )


INCLUDE = '<xacro:include filename="$(find {})/arm.xacro"/>'


def package(folder: FilePath, name: str, body: str = ARM) -> FilePath:
    """A package with a file arm.xacro."""
    folder.mkdir(parents=True)
    # The name in a comment is none.
    (folder / "package.xml").write_text(
        f"<package><!-- <name>x</name> --><name>{name}</name></package>"
    )
    write(folder, body, "arm.xacro")
    return folder


@pytest.mark.parametrize(
    ("own", "other"),
    [
        ("ws/arms", "ws/arms"),
        ("ws/arms", "ws/shared"),
        ("ws/arms", "ws/arms/inner"),
        ("src/repository/arms", "src/shared"),
        ("src/repository/arms", "src/other/shared"),
    ],
)
def test_packages_are_found_by_their_package_file(own, other, tmp_path):
    package(tmp_path / own, "arms")
    if other != own:
        package(tmp_path / other, "shared_parts")
    name = "arms" if other == own else "shared_parts"
    (tmp_path / own / "urdf").mkdir()
    assert load(write(tmp_path / own / "urdf", INCLUDE.format(name))).dof == 1


def test_of_packages_of_one_name_the_named_one_is_read_then_the_nearest(tmp_path):
    two = ARM.replace('name="turn"', 'name="twist"')
    package(tmp_path / "ws" / "arms", "arms")
    package(tmp_path / "ws" / "shared", "shared")
    package(tmp_path / "far" / "shared", "shared", two)
    file = write(tmp_path / "ws" / "arms", INCLUDE.format("shared"))
    assert load(file).joint_names == ("turn",)
    named = {"shared": tmp_path / "far" / "shared"}
    arm = ac.load_arm(file, trust_xacro=True, packages=named)
    assert arm.joint_names == ("twist",)


def test_a_package_that_is_not_found_is_named_where_it_is_read(tmp_path, refuses):
    words = ("it reads files of the package 'far'", "packages={'far': ...}", "--package far=")
    for body in (INCLUDE.format("far"), INCLUDE.format("far").replace("arm.xacro", "*.xacro"),
                 INCLUDE.format("far").replace("<xacro:include", '<xacro:include optional="true"'),
                 link("${xacro.load_yaml('$(find far)/a.yaml')}")):  # fmt: skip
        refuses(lambda x=body: load(write(tmp_path, x)), ac.InvalidInput, *words)
    # Only named, as by controllers of a simulator, it does no harm.
    assert load(write(tmp_path, f"<gazebo><p>$(find far)/c.yaml</p></gazebo>{ARM}")).dof == 1
    refuses(
        lambda: ac.load_arm(
            write(tmp_path, ARM), trust_xacro=True, packages={"far": tmp_path / "none"}
        ),
        ac.InvalidInput, "The folder of the package far,", "is not there",
    )  # fmt: skip


def test_files_outside_of_packages_stay_unread(tmp_path, refuses):
    package(tmp_path / "ws" / "arms", "arms")
    (tmp_path / "ws" / "secret.yaml").write_text("a: 1")
    (tmp_path / "ws" / "plain").mkdir()
    write(tmp_path / "ws" / "plain", ARM, "arm.xacro")
    package(tmp_path / "ws" / "shared", "shared")
    # A folder without a package file, a file beside the packages, a package that is not named.
    for body, words in (
        (link("${xacro.load_yaml('../secret.yaml')}"), "outside of the folder"),
        (INCLUDE.replace("$(find {})", "../plain"), "outside of the folder"),
        (INCLUDE.replace("$(find {})", "../shared"), "outside of the folder"),
        (INCLUDE.replace("$(find {})", "$(find shared)/../plain"), "outside of the folder"),
        (INCLUDE.format("plain"), "it reads files of the package 'plain'"),
    ):
        refuses(lambda x=body: load(write(tmp_path / "ws" / "arms", x)), ac.InvalidInput, words)


@pytest.mark.parametrize(
    ("arguments", "name"),
    [({"size": "3"}, "l3_no"), ({"size": 4, "soft": True}, "l4_true"), ({"size": 0.5}, "l0.5_no")],
)
def test_arguments_are_given(arguments, name, tmp_path):
    body = '<xacro:arg name="soft" default="no"/>' + ARM.replace(
        '"hand"', '"l$(arg size)_$(arg soft)"'
    )
    file = write(tmp_path, body)
    arm = ac.load_arm(file, trust_xacro=True, arguments=arguments, tip=name)
    assert arm.dof == 1


def test_arguments_that_lack_or_are_too_many_are_named(tmp_path, refuses):
    file = write(tmp_path, '<xacro:arg name="soft" default="no"/>' + ARM)
    refuses(
        lambda: ac.load_arm(file, trust_xacro=True, arguments={"sofd": True}),
        ac.InvalidInput, "it has no argument 'sofd': it takes soft",
    )  # fmt: skip
    for text in ("$(arg size)", "${xacro.arg('size')}", r"$(eval arg('size'${'\x29'})"):
        refuses(
            lambda x=text: load(write(tmp_path, link(x))),
            ac.InvalidInput, "it needs a value of its argument 'size'", "--xacro-arg size=VALUE",
        )  # fmt: skip
    refuses(
        lambda: ac.load_arm(file, trust_xacro=True, arguments={"soft": [1]}),
        ac.InvalidInput,
        "The argument soft of a xacro file must be text",
    )
    (tmp_path / "robot.urdf").write_text(f"{HEAD}{ARM}</robot>")
    refuses(
        lambda: ac.load_arm(tmp_path / "robot.urdf", arguments={"a": 1}),
        ac.InvalidInput,
        "takes no arguments",
    )
    for given in ({"arguments": {"a": 1}}, {"packages": {"a": tmp_path}}):
        refuses(lambda x=given: ac.load_arm("ur5e", **x), ac.InvalidInput, "packages or arguments")


def test_time_is_limited(tmp_path, refuses):
    file = write(tmp_path, ENDLESS)
    started = time.monotonic()
    refuses(lambda: expand_xacro(file, seconds=0.5), ac.InvalidInput, "longer than 0.5 s")
    assert time.monotonic() - started < 3
    assert os.listdir(tmp_path) == ["robot.xacro"]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="not every system limits memory")
def test_memory_is_limited(tmp_path, refuses):
    doubled = "".join(
        f'<xacro:property name="a{i}" value="${{a{i - 1} + a{i - 1}}}"/>' for i in range(1, 13)
    )
    first = '<xacro:property name="a0" value="${[0] * 100000}"/>'
    file = write(tmp_path, first + doubled + link("${len(a12)}"))
    refuses(lambda: load(file), ac.InvalidInput, "robot.xacro", "more memory than")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_the_process_dies_with_its_parent(tmp_path):
    file = write(tmp_path, ENDLESS)
    program = (
        "from pathlib import Path; from armcontour._xacro.expanding import expand_xacro; "
        f"expand_xacro(Path({str(file)!r}), seconds=60)"
    )
    parent = subprocess.Popen([sys.executable, "-c", program])
    children = FilePath(f"/proc/{parent.pid}/task/{parent.pid}/children")

    def wait_for(done, seconds=20.0):
        end = time.monotonic() + seconds
        while not done():
            assert time.monotonic() < end
            time.sleep(0.02)

    try:
        wait_for(lambda: children.read_text().split())
        (child,) = children.read_text().split()
        status = FilePath(f"/proc/{child}/stat")
        time.sleep(0.3)
        assert status.exists()
    finally:
        parent.kill()
        parent.wait()
    # It may stay as an entry without a process, Z, where nobody waits for it.
    wait_for(lambda: not status.exists() or status.read_text().split()[2] == "Z", 5.0)


@pytest.mark.parametrize(
    ("call", "said"),
    [
        ("os.system('touch PWNED')", "it calls os.system"),
        ("open('PWNED', 'w')", "it writes 'PWNED'"),
        ("open('/etc/passwd')", "it reads '/etc/passwd'"),
        ("os.listdir('/')", "it reads '/'"),
        ("os.fork()", "it calls os.fork"),
        ("__import__('ctypes')", "it loads the module"),
        ("__import__('_posixsubprocess')", "it loads the module"),
        ("os.environ.update(a='b')", "it calls os.putenv"),
    ],
)
def test_what_gets_past_the_checks_of_expressions_is_stopped_too(call, said, tmp_path):
    program = (
        "import os; from armcontour._xacro import guard; "
        f"guard.watch(guard.Reading({str(tmp_path / 'robot.xacro')!r})); {call}"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], cwd=tmp_path, capture_output=True, text=True
    )
    assert done.returncode == 1 and f"Refused: {said}" in done.stderr
    assert not os.listdir(tmp_path)


def evaluate(text: str, **symbols: object) -> object:
    return eval(compile_expression(text), {"__builtins__": OPERATIONS, **symbols})


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2**0.5 * -3 + 7 % 4 - (1 << 4)", 2**0.5 * -3 + 3 - 16),
        ("[1, 2] * 2 + x[1:]", [1, 2, 1, 2, 5]),
        ("'%s_%.3f' % ('a', 1/3)", "a_0.333"),
        ("'a' if x[0] > 1 and not x[1] in (2, 3) else {'b': [*x]}", "a"),
        ("'a_b'.split('_')[0].upper()", "A"),
        ("2 ** 2000 // 2 ** 1999", 2),
    ],
)
def test_plain_expressions_keep_their_values(text, value):
    assert evaluate(text, x=[4, 5]) == value


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("lambda: 1", "a lambda"),
        ("[x for x in y]", "a comprehension"),
        ("{x for x in y}", "a comprehension"),
        ("{x: x for x in y}", "a comprehension"),
        ("list(x for x in y)", "a generator"),
        ("f'{x}'", "a formatted string"),
        ("(x := 1)", "an assignment"),
        ("x.__class__", "the attribute __class__"),
        ("x._private", "the attribute _private"),
        ("x.gi_frame", "the attribute gi_frame"),
        ("x.cr_frame", "the attribute cr_frame"),
        ("x.ag_frame", "the attribute ag_frame"),
        ("x.tb_frame", "the attribute tb_frame"),
        ("x.f_globals", "the attribute f_globals"),
        ("x.func_globals", "the attribute func_globals"),
        ("'{0.__class__}'.format(x)", "the attribute format"),
        ("'{a}'.format_map(x)", "the attribute format_map"),
        ("'a'.rjust(10**9)", "the attribute rjust"),
        ("__builtins__", "the name __builtins__"),
        ("__power(9, 9)", "the name __power"),
        ("x" * 20_000, "20000 characters"),
        ("'%99999999d' % 1", "a width above 100"),
        ("'%*d' % (10**9, 1)", "a width above 100"),
        ("1 << 10**9", "more than 4096 bits"),
        ("10**9 * [0]", "more than 100000 items"),
        ("x**x**x", "more than 4096 bits"),
    ],
)
def test_expressions_that_are_refused(text, said):
    with pytest.raises(Refused, match=said.replace("*", r"\*")):
        evaluate(text, x=999)
