"""The page's server: on the loopback address alone, for who knows the address that it prints."""

from __future__ import annotations

import contextlib
import mimetypes
import os
import secrets
import shutil
import socket
import tempfile
from collections.abc import AsyncIterator, Callable, Iterator
from functools import partial
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

from polaropt.capture import parsed_json
from polaropt.errors import InputError, check_installed
from polaropt.progress import Progress
from polaropt.reporting import RESULT_FILES, page_template
from polaropt.web.desk import MOST_FILES, Arriving, Busy, Desk, Gone, Laid, TooLarge, names_in_order
from polaropt.web.work import ARCHIVE, LOOK, PHOTOGRAPH, RESULTS, asked_of, look, separated

if TYPE_CHECKING:
    from starlette.applications import Starlette
    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.types import ASGIApp, Receive, Scope, Send

EXTRA = "app"
"""What is installed beside polaropt for the page."""
_HERE = "polaropt.web"
_LOOPBACK = "127.0.0.1"
_HOSTS = (_LOOPBACK, "localhost")
"""Names by which a browser may ask: a page of another site whose name was made to point here has its own."""
_KEY_BYTES = 18
"""Of the part of the address that nobody guesses: other people of the computer reach the port, too."""
_MOST_JSON = 65536
"""Bytes of what the page says beside photographs; set by hand."""
_BYTES_AT_ONCE = 1 << 18
"""Of a file that is sent; set by hand."""
_SECONDS_TO_END = 3
"""That downloads have when the program is ended; set by hand."""
_KINDS = {"inspect": look, "separate": separated}
_WORDS = {
    Busy: (409, "Another capture is being worked on; wait until it is done, or cancel it."),
    Arriving: (409, "The photographs are still being sent; wait until all are here."),
    Gone: (404, "These photographs are no longer here: others took their place. Choose them again."),
}
_SCRIPTS = "script-src 'self'"
_POLICY = (
    "default-src 'none'; {}; style-src 'self' 'unsafe-inline'; img-src 'self' data:; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
"""What a page may load: nothing from elsewhere."""


def serve(port: int, most_bytes: int, ready: Callable[[str], None]) -> None:
    """Serve the page until Ctrl-C or a signal to end; what was dropped on it is removed then.

    Parameters
    ----------
    port : int
        Of the loopback address; 0: one that is free.
    most_bytes : int
        Of the files of one capture.
    ready : callable
        Called with the page's address, once it answers.

    Raises
    ------
    InputError
        The port is taken, or the extra is not installed.
    """
    check_installed(("starlette", "uvicorn"), "the page", f"'polaropt[{EXTRA}]'")
    import uvicorn

    try:
        listening = socket.create_server((_LOOPBACK, port))
    except OSError as error:
        raise InputError(f"--port {port} cannot be used ({error.strerror or error}); give another, or 0") from None
    folder = Path(tempfile.mkdtemp(prefix="polaropt-app-"))
    key = secrets.token_urlsafe(_KEY_BYTES)
    address = f"http://{_LOOPBACK}:{listening.getsockname()[1]}/{key}/"
    desk = Desk(folder, most_bytes)
    config = uvicorn.Config(
        application(desk, key, most_bytes, ready=lambda: ready(address)),
        log_level="warning",
        access_log=False,
        server_header=False,
        proxy_headers=False,
        timeout_graceful_shutdown=_SECONDS_TO_END,
    )
    try:
        with listening, contextlib.suppress(KeyboardInterrupt):
            uvicorn.Server(config).run(sockets=[listening])
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def application(desk: Desk, key: str, most_bytes: int, *, ready: Callable[[], None] | None = None) -> Starlette:
    """The page and what it asks for, below a path that is the key.

    Parameters
    ----------
    desk : Desk
    key : str
    most_bytes : int
        Of the files of one capture, which the page tells.
    ready : callable, optional
        Called when it begins to answer.
    """
    from starlette.applications import Starlette
    from starlette.middleware import Middleware
    from starlette.middleware.trustedhost import TrustedHostMiddleware
    from starlette.routing import Mount, Route, Router

    @contextlib.asynccontextmanager
    async def lifespan(_: Starlette) -> AsyncIterator[None]:
        if ready is not None:
            ready()
        yield
        desk.clear_all()

    def route(path: str, answer: Callable[[Desk, Request], Any], method: str) -> Route:
        return Route(path, _answering(partial(answer, desk)), methods=[method])

    page = partial(_page, most_bytes)
    routes = [
        Route("/", page),
        *(Route(f"/{name}", partial(_static, name)) for name in ("page.css", "page.js", "compare.js")),
        route("/job", _working, "GET"),
        route("/job", _cancel_any, "DELETE"),
        route("/captures", _lay, "POST"),
        route("/captures/{capture}/files/{name:path}", _take, "PUT"),
        route("/captures/{capture}/job", _start, "POST"),
        route("/captures/{capture}/job", _state, "GET"),
        route("/captures/{capture}/job", _cancel, "DELETE"),
        route("/captures/{capture}", _clear, "DELETE"),
        route("/captures/{capture}/{name}", _file, "GET"),
        route("/captures/{capture}/" + RESULTS + "/{name}", _result, "GET"),
    ]
    app = Starlette(
        routes=[Mount(f"/{key}", app=Router(routes, redirect_slashes=False))],
        middleware=[
            Middleware(TrustedHostMiddleware, allowed_hosts=list(_HOSTS), www_redirect=False),
            Middleware(OwnPagesOnly),
        ],
        lifespan=lifespan,
    )
    app.router.redirect_slashes = False
    return app


class OwnPagesOnly:
    """Refuses what other sites' pages ask for, and says of every answer that it is not for them."""

    def __init__(self, app: ASGIApp) -> None:
        self._app = app

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        from starlette.datastructures import Headers, MutableHeaders
        from starlette.responses import PlainTextResponse

        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def guarded(message: Any) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                headers.setdefault("content-security-policy", _POLICY.format(_SCRIPTS))
                headers["x-content-type-options"] = "nosniff"
                headers["referrer-policy"] = "no-referrer"
                headers["cross-origin-resource-policy"] = "same-origin"
                headers["cross-origin-opener-policy"] = "same-origin"
                headers["cache-control"] = "no-store"
            await send(message)

        # Browsers say whose page asks; "none" is a person who typed or opened the address.
        if Headers(scope=scope).get("sec-fetch-site", "none") not in ("same-origin", "none"):
            await PlainTextResponse("Only polaropt's own page may ask.", 403)(scope, receive, guarded)
            return
        await self._app(scope, receive, guarded)


def _answering(answer: Callable[[Request], Any]) -> Callable[[Request], Any]:
    """What goes wrong as a sentence in JSON."""
    from starlette.responses import JSONResponse

    async def answered(request: Request) -> Response:
        try:
            response: Response = await answer(request)
            return response
        except (Busy, Arriving, Gone) as error:
            code, sentence = _WORDS[type(error)]
            return JSONResponse({"problem": sentence, "busy": isinstance(error, Busy)}, code)
        except TooLarge as error:
            return JSONResponse({"problem": f"Not taken: {error}."}, 413)
        except InputError as error:
            return JSONResponse({"problem": str(error)}, 400)

    return answered


async def _page(most_bytes: int, request: Request) -> Response:
    from starlette.responses import HTMLResponse

    return HTMLResponse(page_template(_HERE, "page.html").render(limit_mb=most_bytes / 1e6, most_files=MOST_FILES))


async def _static(name: str, request: Request) -> Response:
    from starlette.responses import Response

    kind = "text/css" if name.endswith(".css") else "text/javascript"
    if name == "compare.js":
        return Response(page_template("polaropt.reporting", name).render(), media_type=kind)
    if name == "page.css":
        return Response(page_template(_HERE, name).render(), media_type=kind)
    return Response(files(_HERE).joinpath(name).read_bytes(), media_type=kind)


async def _lay(desk: Desk, request: Request) -> Response:
    """A new capture: of which files, in which order and at which angles, as far as their names tell."""
    from starlette.responses import JSONResponse

    document = await _json(request)
    names = document.get("names") if isinstance(document, dict) else None
    if not isinstance(names, list) or not names or not all(_is_text(name) for name in names):
        raise InputError("no files are named; choose some")
    if len(names) > MOST_FILES:
        raise TooLarge(f"more than {MOST_FILES} files; give the photographs of one capture")
    if len(names) == 2:
        raise InputError("two photographs hold two polarizer angles; at least three are needed, or one raw mosaic")
    listed = [{"name": name, "angle": angle} for name, angle in names_in_order(names)]
    return JSONResponse({"capture": desk.lay().name, "files": listed}, 201)


async def _take(desk: Desk, request: Request) -> Response:
    """One of its files, written as it comes."""
    from starlette.requests import ClientDisconnect
    from starlette.responses import JSONResponse

    laid = _idle(desk, request)
    try:
        with laid.new_file(request.path_params["name"]) as path, path.open("wb") as file:
            async for chunk in request.stream():
                laid.count(len(chunk))
                file.write(chunk)
    except TooLarge:
        _drop(desk, laid)
        raise
    except ClientDisconnect:
        _drop(desk, laid)
        raise Gone from None
    except OSError as error:
        _drop(desk, laid)
        raise InputError(f"the photographs cannot be kept ({error.strerror or error}); make room") from None
    # Others may have taken its place meanwhile.
    desk.laid(laid.name)
    return JSONResponse({"bytes": laid.n_bytes}, 201)


def _drop(desk: Desk, laid: Laid) -> None:
    """Remove a capture, unless another one took its place."""
    with contextlib.suppress(Gone):
        if desk.laid(laid.name) is laid:
            desk.clear()


def _is_text(name: object) -> bool:
    """Whether it is text: JSON may hold halves of characters."""
    return isinstance(name, str) and not any("\ud800" <= sign <= "\udfff" for sign in name)


def _idle(desk: Desk, request: Request) -> Laid:
    """The capture that is asked for, which nothing works on."""
    laid = desk.laid(request.path_params["capture"])
    job = desk.job(laid.name)
    if job is not None and job.running:
        raise Busy
    return laid


async def _start(desk: Desk, request: Request) -> Response:
    from starlette.responses import JSONResponse

    document = await _json(request)
    laid = desk.laid(request.path_params["capture"])
    kind = document.get("do") if isinstance(document, dict) else None
    if not isinstance(kind, str) or kind not in _KINDS:
        raise InputError(f"there is no {kind!r}; choose one of: {', '.join(_KINDS)}")
    files = laid.whole_files()
    asked = asked_of(document.get("options", {}), len(files))

    def work(tell: Progress) -> str:
        return _KINDS[kind](laid.folder, files, asked, tell)

    desk.start(kind, work)
    return JSONResponse({}, 202)


async def _state(desk: Desk, request: Request) -> Response:
    from starlette.responses import JSONResponse

    job = desk.job(request.path_params["capture"])
    return JSONResponse(None if job is None else vars(job))


async def _cancel(desk: Desk, request: Request) -> Response:
    from starlette.responses import JSONResponse

    desk.laid(request.path_params["capture"])
    desk.cancel()
    return JSONResponse({})


async def _working(desk: Desk, request: Request) -> Response:
    """Whether anything is worked on, by whichever page it was begun."""
    from starlette.responses import JSONResponse

    return JSONResponse({"running": desk.working})


async def _cancel_any(desk: Desk, request: Request) -> Response:
    """End what is worked on: the page that began it may have been closed."""
    from starlette.responses import JSONResponse

    desk.cancel()
    return JSONResponse({})


async def _clear(desk: Desk, request: Request) -> Response:
    from starlette.responses import JSONResponse

    _idle(desk, request)
    desk.clear()
    return JSONResponse({})


async def _file(desk: Desk, request: Request) -> Response:
    """A picture of the page, or all results in one file."""
    laid, name = desk.laid(request.path_params["capture"]), request.path_params["name"]
    if name not in (LOOK, PHOTOGRAPH, ARCHIVE):
        raise Gone
    headers = {"content-disposition": f'attachment; filename="{name}"'} if name == ARCHIVE else {}
    return _sent(laid.folder / name, headers)


async def _result(desk: Desk, request: Request) -> Response:
    """One of the files that a separation writes."""
    laid, name = desk.laid(request.path_params["capture"]), request.path_params["name"]
    if name not in RESULT_FILES:
        raise Gone
    headers = {}
    if name.endswith(".html"):  # its script and pictures stand in itself
        headers["content-security-policy"] = _POLICY.format("script-src 'unsafe-inline'")
    return _sent(laid.folder / RESULTS / name, headers)


def _sent(path: Path, headers: dict[str, str]) -> Response:
    """A file, opened now: others may take the capture's place while it is sent. Gone where it is not there."""
    from starlette.responses import StreamingResponse

    try:
        file = path.open("rb")
    except OSError:
        raise Gone from None

    def parts() -> Iterator[bytes]:
        with file:
            yield from iter(partial(file.read, _BYTES_AT_ONCE), b"")

    size = os.fstat(file.fileno()).st_size
    kind, _ = mimetypes.guess_type(path.name)
    return StreamingResponse(parts(), headers={"content-length": str(size), **headers}, media_type=kind)


async def _json(request: Request) -> Any:
    """What the page says, as JSON of a decent size."""
    text = b""
    async for chunk in request.stream():
        text += chunk
        if len(text) > _MOST_JSON:
            raise TooLarge("the options are longer than any are")
    try:
        return parsed_json(text)
    except ValueError:
        raise InputError("the options are no JSON") from None
