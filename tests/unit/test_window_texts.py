"""Text from files is shown as plain text. This test lists the functions that interpret markup and the files that may
call them."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

import nvsim

APP = Path(nvsim.__file__).parents[1] / "app" / "nvsim_app"
READERS = {  # what takes a text for markup, and the files that may use it
    "QLabel": {"look/labels.py"},
    "QTextBrowser": {"panels/help.py"},
    "QTextEdit": {"panels/help.py"},
    "QTextDocument": {"panels/help.py"},
    **dict.fromkeys(("QMessageBox", "QErrorMessage", "QWhatsThis", "QToolTip", "QGraphicsTextItem"), set()),
    **dict.fromkeys(("QProgressDialog", "QInputDialog", "QWizard", "TextItem", "LabelItem"), set()),
    **dict.fromkeys(("setTextFormat",), {"look/labels.py"}),
    **dict.fromkeys(("setMarkdown",), {"panels/help.py"}),
    **dict.fromkeys(("setHtml", "insertHtml", "addLegend", "setLabels"), set()),
    "setLabel": {"look/theme.py"},
    "appendHtml": {"panels/log.py"},
}


def _own(node: ast.expr | None) -> bool:
    """Words that stand in the program, or went through the module that makes a text plain."""
    match node:
        case None | ast.Constant():
            return True
        case ast.Call(func=ast.Name(id=name)):
            return name in ("tooltip_text", "plain", "escape_html", "caption", "title")
        case ast.IfExp(body=a, orelse=b) | ast.BinOp(left=a, right=b):
            return _own(a) and _own(b)
        case ast.BoolOp(values=values):
            return all(map(_own, values))
        case ast.JoinedStr(values=values):
            return all(_own(v.value if isinstance(v, ast.FormattedValue) else v) for v in values)
    return False


def _slips(source: str, name: str) -> list[str]:
    """Where a text may reach Qt that was not made plain."""
    found: list[str] = []
    for node in ast.walk(ast.parse(source)):
        word = node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""
        if word in READERS and name not in READERS[word]:
            found.append(f"{name}:{node.lineno}: {word}; use Label, tooltip_text or escape_html of look/plain_text.py")
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute):
            called = node.func.attr
            if called in ("setToolTip", "setWhatsThis", "setTabToolTip", "setTabWhatsThis") and not _own(node.args[-1]):
                found.append(f"{name}:{node.lineno}: {called} without tooltip_text()")
            if called == "appendHtml" and not all(_escaped(argument) for argument in node.args):
                found.append(f"{name}:{node.lineno}: appendHtml without escape_html()")
            if called == "setTitle" and any(k.arg == "size" for k in node.keywords) and not _own(node.args[0]):
                found.append(f"{name}:{node.lineno}: the title of a plot without escape_html()")
        if isinstance(node, ast.keyword) and node.arg == "toolTip" and not _own(node.value):
            found.append(f"{name}:{node.value.lineno}: toolTip without tooltip_text()")
        if isinstance(node, ast.If) and "ToolTipRole" in ast.dump(node.test):
            for line in node.body:
                if isinstance(line, ast.Return) and not _own(line.value):
                    found.append(f"{name}:{line.lineno}: a tool tip of a model without tooltip_text()")
    return found


def _escaped(markup: ast.expr) -> bool:
    """Of an f-string: figures and colors, and texts by `escape_html`."""
    for part in ast.walk(markup):
        if isinstance(part, ast.FormattedValue) and isinstance(part.value, ast.Attribute) and part.value.attr == "text":
            return False
        if isinstance(part, ast.FormattedValue) and isinstance(part.value, ast.Call) and not _own(part.value):
            return False
    return True


def test_no_file_of_the_window_goes_around_the_module_that_makes_texts_plain() -> None:
    found = [s for f in sorted(APP.rglob("*.py")) for s in _slips(f.read_text(), f.relative_to(APP).as_posix())]
    assert found == []


@pytest.mark.parametrize(
    "line",
    [
        "label = QLabel(job.title)",
        "button.setToolTip(frame.name)",
        "label = Label(words, self, toolTip=frame.name)",
        "button.setToolTip(f'Open {frame.name}')",
        "item.setToolTip(0, words if words else 'nothing')",
        "if role == Qt.ItemDataRole.ToolTipRole:\n    return row.note",
        "QMessageBox.warning(self, 'NVSim', str(error))",
        "plot.addItem(pyqtgraph.TextItem(html=name))",
        "plot.setTitle(column, size='9pt')",
        "self.appendHtml(f'<b>{notice.text}</b>')",
    ],
)
def test_who_forgets_it_is_told(line: str) -> None:
    assert _slips(line, "panels/new.py" if "appendHtml" not in line else "panels/log.py")
