# The forms of contact.cpp, for FFCx: residual and tangent of a neo-Hookean body.
from basix.ufl import element
from ufl import (
    Coefficient,
    Constant,
    FunctionSpace,
    Identity,
    Mesh,
    TestFunction,
    TrialFunction,
    derivative,
    det,
    dx,
    grad,
    inner,
    ln,
)

mesh = Mesh(element("Lagrange", "hexahedron", 1, shape=(3,)))
V = FunctionSpace(mesh, element("Lagrange", "hexahedron", 2, shape=(3,)))

u = Coefficient(V)  # displacement
mu = Constant(mesh)  # Lamé's constants
lmbda = Constant(mesh)

G = Identity(3) + grad(u)
energy = mu / 2 * (inner(G, G) - 3 - 2 * ln(det(G))) + lmbda / 2 * ln(det(G)) ** 2
F = derivative(energy * dx(degree=4), u, TestFunction(V))
J = derivative(F, u, TrialFunction(V))

forms = [F, J]
