from uuvsim_cosim.fmus.instantiate import instantiate_fmu
import numpy as np, pytest
@pytest.mark.parametrize("iso",[False,True])
@pytest.mark.parametrize("name",["first_order_fmi2","first_order_fmi3","pythonfmu2_lag","pythonfmu3_lag","pythonfmu2_controller","pythonfmu3_controller"])
def test_x(request,name,iso):
    p=request.getfixturevalue(name)
    c=instantiate_fmu(p,"a.b",isolate=iso)
    d=c.description
    print(name,type(c).__name__,{v.name:(v.type,v.shape,v.causality) for v in d.variables.values()})
    c.enter_initialization_mode(0,1.0); c.exit_initialization_mode()
    if "u" in d.variables:
        c.set(d.variables["u"],1.0); c.do_step(0,0.1); print(c.get(d.variables["y"]))
    else:
        c.set(d.variables["eta_d"],np.ones(6)); c.do_step(0,0.1); print(c.get(d.variables["tau_d"]))
    print(c.messages)
    c.terminate(); c.free(); c.free()
