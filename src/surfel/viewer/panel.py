"""Panel: the controls beside the picture, and what is told there."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from surfel.core.errors import SurfelError
from surfel.viewer.probe import probe
from surfel.viewer.stage import OPERATIONS, Join

if TYPE_CHECKING:
    from surfel.core.estimate import Estimate
    from surfel.measuring.measurement import Measurement
    from surfel.viewer.viewer import Viewer

_BUSY = "*measuring ...*"
_DRAWN = "draw on the server"


class Panel:
    """Folders of controls; every one of them calls the viewer."""

    def __init__(self, server: Any, viewer: Viewer) -> None:
        self._server, self._viewer = server, viewer
        gui = server.gui
        self._numbers = gui.add_markdown(_BUSY)
        with gui.add_folder("Solids"):
            self._solids = gui.add_folder("Parts", expand_by_default=True)
            self._operations = gui.add_folder("Operations", expand_by_default=True)
        self._dropdowns: list[Any] = []
        with gui.add_folder("Precision", expand_by_default=False):
            self._on_change(
                gui.add_slider("lines, 2^", 10, 20, 1, 14, hint="Lines of a measurement"),
                lambda value: viewer.set(lines=1 << int(value)),
            )
            self._on_change(
                gui.add_slider("cut", 1, 4, 1, 2, hint="How often surfels are halved at the cut"),
                lambda value: viewer.set(level=int(value)),
            )
        with gui.add_folder("Safe surface", expand_by_default=False):
            self._on_change(gui.add_checkbox("show", False), lambda value: viewer.set(lid=bool(value)))
            self._on_change(
                gui.add_slider("coefficients", 6, 60, 1, 20), lambda value: viewer.set(coefficients=int(value))
            )
            self._on_change(gui.add_dropdown("side", ("above", "below")), lambda value: viewer.set(side=value))
            self._on_change(gui.add_dropdown("mode", ("fast", "tight", "paper")), lambda value: viewer.set(mode=value))
        with gui.add_folder("Files"):
            self._add_files(gui)
        server.on_client_connect(self._greet)

    def add_part(self, number: int, shown: int, whole: int) -> None:
        """Add the controls of a part, and say how much of it is shown."""
        part = self._viewer.stage.parts[number]
        with self._solids:
            back = self._server.gui.add_button(f"put {part.name} back", color="gray")
        back.on_click(lambda _: self._viewer.reset(number))
        if shown < whole:
            with self._solids:
                self._server.gui.add_markdown(
                    f"*{shown:,} of the {whole:,} surfels of {part.name} are shown; all are measured and saved*"
                )

    def show_joins(self) -> None:
        """Show a choice for every node of the expression."""
        joins = self._viewer.stage.joins
        if len(joins) == len(self._dropdowns):
            return
        for old in self._dropdowns:
            old.remove()
        self._dropdowns = []
        for number, join in enumerate(joins):
            with self._operations:
                choice = self._server.gui.add_dropdown(_label(join), tuple(OPERATIONS), initial_value=join.operation)
            self._on_change(choice, partial(self._viewer.switch, number))
            self._dropdowns.append(choice)

    def busy(self) -> None:
        """Say that numbers are on their way."""
        if _BUSY not in self._numbers.content:
            self._numbers.content = f"{self._numbers.content}\n\n{_BUSY}"

    def tell(self, found: Measurement, text: str) -> None:
        """Show area and volume with their errors."""
        lines = [f"**area** {_told(found.area)}"]
        lines.append(f"**volume** {_told(found.volume)}" if found.volume is not None else "no volume: a sheet")
        lines += [text] if text else []
        lines += [f"*{warning}*" for warning in found.warnings]
        self._numbers.content = "\n\n".join(lines)

    def complain(self, title: str, text: str, client: Any = None) -> None:
        """Show a message: to one client, or to all of them."""
        for one in [client] if client is not None else list(self._server.get_clients().values()):
            one.add_notification(title, text, color="red", auto_close_seconds=None)
        if client is None:
            self._numbers.content = f"**{title}:** {text}"

    def _greet(self, client: Any) -> None:
        """Let each client choose who draws for it; a page without a graphics card chooses by itself, unless told."""
        always = self._viewer.draw == "server"
        drawn = client.gui.add_checkbox(_DRAWN, always, hint="Finished pictures, for browsers without a graphics card")
        drawn.on_update(lambda event: self._for_client(event, self._viewer.draw_on_server, bool(drawn.value)))
        if always:
            self._viewer.draw_on_server(client, True)
        elif self._viewer.draw == "auto":
            client.gui.add_html(probe(_DRAWN))

    def _add_files(self, gui: Any) -> None:
        upload = gui.add_upload_button("load a file")
        upload.on_upload(
            lambda event: self._for_client(
                event, lambda _, file: self._viewer.load(file.name, file.content), upload.value
            )
        )
        save = gui.add_button("save the result")
        save.on_click(
            lambda event: self._for_client(
                event, lambda client: client.send_file_download("result.ply", self._viewer.result_file())
            )
        )
        picture = gui.add_button("save the picture")
        picture.on_click(
            lambda event: self._for_client(
                event, lambda client: client.send_file_download("picture.png", self._viewer.picture_file(client))
            )
        )
        python = gui.add_button("show the Python")
        python.on_click(lambda event: self._for_client(event, self._show_python))

    def _show_python(self, client: Any) -> None:
        with client.gui.add_modal("Python") as window:
            client.gui.add_markdown(f"```python\n{self._viewer.script()}```")
            client.gui.add_button("close").on_click(lambda _: window.close())

    def _for_client(self, event: Any, job: Callable[..., object], *given: Any) -> None:
        """Do what a client asked for; what goes wrong is told to that client, and the page lives on."""
        if event.client is None:
            return
        try:
            job(event.client, *given)
        except SurfelError as error:
            self.complain("That did not work", str(error), event.client)
        except Exception as error:  # a page must not die of one click
            self.complain("That did not work", f"{type(error).__name__}: {error}", event.client)

    @staticmethod
    def _on_change(control: Any, change: Callable[[Any], None]) -> None:
        control.on_update(lambda event: change(event.target.value))


def _label(join: Join) -> str:
    return ", ".join(dict.fromkeys(part.name for part in join.parts()))


def _told(estimate: Estimate) -> str:
    text = str(estimate).replace("+-", "±")
    return text if estimate.reliable else f"{text} *({estimate.reason})*"
