/* What makes the modules of the compiled engine importable. All of them are in one library, which holds a function for each that
   makes the module; Python wants a file of its own for each. This is compiled once, and every module gets a copy of it: the copy
   learns from Python which module it is there for. setup.py writes modules.h. */

#include <Python.h>
#include "modules.h"

static PyObject *
create(PyObject *spec, PyModuleDef *unused)
{
    PyObject *capsule = NULL, *function = NULL, *module = NULL, *path = NULL;
    PyObject *library = PyImport_ImportModule(LIBRARY);
    PyObject *name = PyObject_GetAttrString(spec, "name");
    PyObject *flat = name == NULL ? NULL : PyObject_CallMethod(name, "replace", "ss", ".", "___");
    if (library != NULL && flat != NULL) {
        function = PyUnicode_FromFormat("init_%U", flat);
        path = PyUnicode_FromFormat(LIBRARY ".init_%U", flat);
    }
    if (function != NULL && path != NULL)
        capsule = PyObject_GetAttr(library, function);
    if (capsule != NULL) {
        const char *expected = PyUnicode_AsUTF8(path);
        PyObject *(*make)(void) = expected == NULL ? NULL : (PyObject *(*)(void))PyCapsule_GetPointer(capsule, expected);
        if (make != NULL)
            module = make();
    }
    Py_XDECREF(capsule);
    Py_XDECREF(path);
    Py_XDECREF(function);
    Py_XDECREF(flat);
    Py_XDECREF(name);
    Py_XDECREF(library);
    return module;
}

static PyModuleDef_Slot slots[] = {
    {Py_mod_create, (void *)create},
    {0, NULL},
};

static PyModuleDef definition = {
    PyModuleDef_HEAD_INIT,
    .m_name = LIBRARY,
    .m_slots = slots,
};

/* Python looks for a function with the last part of the module's name. */
#define MODULE(name) PyMODINIT_FUNC PyInit_##name(void) { return PyModuleDef_Init(&definition); }

MODULES
