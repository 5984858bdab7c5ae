"""Faults built into a module asleep: one operator, constant, comparison or branch each."""

from __future__ import annotations

import ast
import copy
from collections.abc import Mapping
from typing import NamedTuple

COMPILERS = {"kernel", "internal", "inlined", "allocating"}
"""Decorators of compiled functions, which would be compiled anew for each fault."""

OPPOSITES: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.And: ast.Or,
    ast.Lt: ast.LtE,
    ast.Gt: ast.GtE,
    ast.Eq: ast.NotEq,
    ast.Is: ast.IsNot,
    ast.In: ast.NotIn,
}
OPPOSITES |= {new: old for old, new in OPPOSITES.items()}
"""Operator that replaces another one."""

WAKE = "__fault_is_awake__"
"""Function among the builtins that instrumented code asks with a fault's number."""


class Site(NamedTuple):
    """A place of a module at which one fault may be."""

    line: int
    before: str
    after: str


class _Builder(ast.NodeTransformer):
    """Walker that lists the sites of a module, and builds faults into some of them."""

    def __init__(self, numbers: Mapping[int, int]) -> None:
        """Take the numbers of faults, by the index of their site."""
        self.numbers = numbers
        self.sites: list[Site] = []
        self.depth = 0  # functions around the node

    def visit(self, node: ast.AST) -> ast.AST:
        """Visit a node, unless it is an annotation or a text, which change nothing."""
        return node if isinstance(node, ast.JoinedStr | ast.arguments) else super().visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> ast.AST:
        """Visit the body of a function that is not compiled."""
        names = {
            part.id
            for each in node.decorator_list
            for part in ast.walk(each)
            if isinstance(part, ast.Name)
        }
        if names & COMPILERS:
            return node
        self.depth += 1
        node.body = [self.visit(each) for each in node.body]
        self.depth -= 1
        return node

    def visit_AnnAssign(self, node: ast.AnnAssign) -> ast.AST:
        """Visit the value alone."""
        node.value = node.value and self.visit(node.value)
        return node

    def visit_Compare(self, node: ast.Compare) -> ast.AST:
        """Replace a comparison by its neighbour, such as < by <=."""
        return self._replace(node, ops=[OPPOSITES[type(node.ops[0])](), *node.ops[1:]])

    def visit_BoolOp(self, node: ast.BoolOp) -> ast.AST:
        """Replace `and` by `or`."""
        return self._replace(node, op=OPPOSITES[type(node.op)]())

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Replace plus by minus."""
        kind = OPPOSITES.get(type(node.op))
        return self._replace(node, op=kind()) if kind else self.generic_visit(node)

    def visit_Constant(self, node: ast.Constant) -> ast.AST:
        """Add one to a number."""
        is_number = isinstance(node.value, int | float) and not isinstance(node.value, bool)
        return self._replace(node, value=node.value + 1) if is_number else node

    def visit_UnaryOp(self, node: ast.UnaryOp) -> ast.AST:
        """Leave `not` away."""
        if not isinstance(node.op, ast.Not):
            return self.generic_visit(node)
        return self._build(node, node.operand)

    def visit_If(self, node: ast.If) -> ast.AST:
        """Take no branch."""
        node.test = self._build(node.test, ast.Constant(False))
        node.body = [self.visit(each) for each in node.body]
        node.orelse = [self.visit(each) for each in node.orelse]
        return node

    def _replace(self, node: ast.expr, **fields: object) -> ast.AST:
        """Build a copy of an expression with other fields."""
        fault = copy.copy(node)
        for name, value in fields.items():
            setattr(fault, name, value)
        return self._build(node, fault)

    def _build(self, node: ast.expr, fault: ast.expr) -> ast.expr:
        """List a site, and build its fault in if that is wanted; visit what is within."""
        if not self.depth:
            return node
        number = self.numbers.get(len(self.sites))
        asleep = copy.deepcopy(fault)
        self.sites.append(Site(node.lineno, ast.unparse(node), ast.unparse(fault)))
        is_test = isinstance(fault, ast.Constant) and fault.value is False
        inner = self.visit(node) if is_test else self.generic_visit(node)
        if number is None:
            return inner
        question = ast.Call(ast.Name(WAKE, ast.Load()), [ast.Constant(number)], [])
        return ast.fix_missing_locations(
            ast.copy_location(ast.IfExp(question, asleep, inner), node)
        )


def build_faults(source: str, numbers: Mapping[int, int]) -> tuple[ast.Module, list[Site]]:
    """Return a module with the faults of some sites asleep, and all its sites.

    ``numbers`` has the fault's number for each index of a site.
    """
    builder = _Builder(numbers)
    tree = ast.parse(source)
    module = builder.visit(tree)
    return module, builder.sites
