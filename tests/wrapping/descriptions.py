"""Model descriptions to wrap, the awkward among them written by hand, and what reads the result."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

from fmpy.model_description import ModelDescription, ModelVariable, read_model_description

from fmucorrect.signals import Channel
from fmucorrect.wrapping.added import Added
from fmucorrect.wrapping.description import Capabilities, Description, Outer, describe

FMUS = Path(__file__).parents[2] / "fmus"
CHANNELS = (Channel("FW", "mm"), Channel("RW", "m/s2"))
ALL = Capabilities(state=True, serialise=True)

AWKWARD_2 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="2.0" modelName="A.B" guid="{1}" generationDateAndTime="2020-01-01T00:00:00Z"
  numberOfEventIndicators="2" variableNamingConvention="structured" author="Someone" xmlns:tool="http://tool.example/1">
<ModelExchange modelIdentifier="ab_me"/>
<CoSimulation modelIdentifier="ab" canInterpolateInputs="true" maxOutputDerivativeOrder="3" canRunAsynchronuously="true"
  canGetAndSetFMUstate="true" providesDirectionalDerivative="1" canHandleVariableCommunicationStepSize="true">
  <SourceFiles><File name="all.c"/></SourceFiles></CoSimulation>
<UnitDefinitions><Unit name="mm"><BaseUnit m="1"/></Unit><Unit name="km/h"><BaseUnit m="1" s="-1" factor="0.27777777777"/>
  </Unit><Unit name="deg"/><Unit name="m"><BaseUnit m="1"/><DisplayUnit name="mm" factor="1000"/></Unit></UnitDefinitions>
<TypeDefinitions><SimpleType name="Gear"><Enumeration quantity="g"><Item name="low" value="1"/><Item name="high" value="-2"
  description="fast"/></Enumeration></SimpleType><SimpleType name="CorrectorStatus" description="theirs"><Real unit="m"
  min="-1"/></SimpleType><SimpleType name="Whole"><Integer max="9"/></SimpleType><SimpleType name="B"><Boolean/>
  </SimpleType><SimpleType name="S"><String/></SimpleType></TypeDefinitions>
<VendorAnnotations><Tool name="T"><tool:a x="1"> keep  <b/>
 this</tool:a></Tool></VendorAnnotations>
<ModelVariables>
<ScalarVariable name="y" valueReference="4294967290" causality="output"><Real declaredType="CorrectorStatus"/></ScalarVariable>
<ScalarVariable name="y_too" valueReference="4294967290" causality="output" description="again"><Real unit="m"
  displayUnit="mm"/></ScalarVariable>
<ScalarVariable name="u" valueReference="7" causality="input"><Real start="0.5" unit="m"/></ScalarVariable>
<ScalarVariable name="u_mirror" valueReference="7"><Real unit="m"/></ScalarVariable>
<ScalarVariable name="u_second" valueReference="7" description="same"><Real unit="m" displayUnit="mm"/></ScalarVariable>
<ScalarVariable name="gear" valueReference="7" causality="parameter" variability="tunable"><Enumeration
  declaredType="Gear" start="1"/></ScalarVariable>
<ScalarVariable name="count" valueReference="7" causality="parameter" variability="fixed" initial="exact"><Integer start="3"
  min="0" declaredType="Whole"/></ScalarVariable>
<ScalarVariable name="on" valueReference="7" causality="input" variability="discrete"><Boolean start="true"
  declaredType="B"/></ScalarVariable>
<ScalarVariable name="file" valueReference="7" causality="parameter" variability="fixed"><String start="a&amp;b &quot;c&quot;"
  declaredType="S"/><Annotations><Tool name="T"><tool:pick/></Tool></Annotations></ScalarVariable>
<ScalarVariable name="x" valueReference="3" initial="exact"><Real start="1" unit="m" reinit="true" unbounded="true"/>
  </ScalarVariable>
<ScalarVariable name="der(x)" valueReference="0"><Real derivative="10"/></ScalarVariable>
<ScalarVariable name="z" valueReference="9" causality="output" variability="discrete"><Integer/></ScalarVariable>
<ScalarVariable name="k" valueReference="12" causality="calculatedParameter" variability="fixed"><Real/></ScalarVariable>
<ScalarVariable name="pi" valueReference="13" variability="constant"><Real start="3.1"/></ScalarVariable>
</ModelVariables>
<ModelStructure><Outputs><Unknown index="1" dependencies="3 10" dependenciesKind="dependent constant"/><Unknown index="2"
  dependencies="3"/><Unknown index="12"/></Outputs><Derivatives><Unknown index="11" dependencies=""/></Derivatives>
  <InitialUnknowns><Unknown index="1" dependencies="3 7"/><Unknown index="2" dependencies="3"/><Unknown index="11"/>
  <Unknown index="12"/><Unknown index="13" dependencies=""/></InitialUnknowns></ModelStructure>
</fmiModelDescription>"""

AWKWARD_3 = """<?xml version="1.0" encoding="UTF-8"?>
<fmiModelDescription fmiVersion="3.0.1" modelName="A.B" instantiationToken="{1}" variableNamingConvention="structured"
  xmlns:v="http://vendor.example/1">
<ModelExchange modelIdentifier="ab"/>
<CoSimulation modelIdentifier="ab" hasEventMode="true" canGetAndSetFMUState="true" canSerializeFMUState="true"
  mightReturnEarlyFromDoStep="true" fixedInternalStepSize="0.25" providesIntermediateUpdate="true"
  canReturnEarlyAfterIntermediateUpdate="true" maxOutputDerivativeOrder="2" recommendedIntermediateInputSmoothness="1"
  providesDirectionalDerivatives="true" providesAdjointDerivatives="true" providesPerElementDependencies="true"
  providesEvaluateDiscreteStates="true" v:own="1"><Annotations><Annotation type="v">note</Annotation></Annotations>
</CoSimulation>
<ScheduledExecution modelIdentifier="ab"/>
<UnitDefinitions><Unit name="m"><BaseUnit m="1"/><DisplayUnit name="mm" factor="1000"/><DisplayUnit name="1/m" inverse="true"/>
  <Annotations><Annotation type="v"/></Annotations></Unit><Unit name="s"><BaseUnit s="1"/></Unit></UnitDefinitions>
<TypeDefinitions><Float32Type name="Short" unit="m"/><Int64Type name="Long" min="-9223372036854775808" max="7"/>
<BinaryType name="Blob"/><EnumerationType name="Gear" min="0" max="9"><Item name="a" value="0"/><Item name="b"
  value="8589934592" description="far"/></EnumerationType><BooleanType name="B"/><ClockType name="C"
  intervalVariability="triggered"/></TypeDefinitions>
<LogCategories><Category name="logEvents"><Annotations><Annotation type="v"/></Annotations></Category></LogCategories>
<DefaultExperiment stepSize="0.01"><Annotations><Annotation type="v"/></Annotations></DefaultExperiment>
<ModelVariables>
<UInt64 name="n" valueReference="4294967290" causality="structuralParameter" variability="tunable" start="3"/>
<Float64 name="t" valueReference="8" causality="independent" variability="continuous" unit="s"/>
<Float64 name="u" valueReference="5" causality="input" start="1 2 3 4 5 6" unit="m" intermediateUpdate="true">
  <Dimension start="2"/><Dimension valueReference="4294967290"/><Alias name="u_also" displayUnit="mm"/></Float64>
<Float32 name="y" valueReference="6" causality="output" declaredType="Short"><Annotations><Annotation type="v"><v:p/>
  </Annotation><Annotation type="w">text</Annotation></Annotations>
  <Alias name="y_also" description="again" displayUnit="1/m"/></Float32>
<Float64 name="x" valueReference="10" initial="exact" start="7" reinit="true"><Dimension start="2"/></Float64>
<Float64 name="der(x)" valueReference="11" derivative="10"><Dimension start="2"/></Float64>
<Int64 name="long" valueReference="12" causality="parameter" variability="tunable" start="-5" declaredType="Long"/>
<UInt8 name="small" valueReference="13" causality="input" initial="exact" start="255" max="255"/>
<Boolean name="on" valueReference="14" causality="parameter" start="true false" declaredType="B"><Dimension start="2"/>
  </Boolean>
<String name="words" valueReference="15" causality="parameter"><Dimension start="2"/><Start value="a b"/><Start value=""/>
  </String>
<Enumeration name="gear" valueReference="16" causality="output" declaredType="Gear"/>
<Binary name="blob" valueReference="17" causality="input" declaredType="Blob"><Start value="00ff"/></Binary>
<Clock name="tick" valueReference="18" causality="input" intervalVariability="triggered"/>
<Int32 name="sampled" valueReference="19" causality="output" clocks="18"/>
<Float64 name="p" valueReference="20" causality="parameter" variability="fixed" start="2"><Alias name="p_also"/></Float64>
<Float64 name="c" valueReference="21" variability="constant" start="4"><Alias name="c_also"/></Float64>
<Float64 name="a[1]" valueReference="22" causality="output" start="1 2" initial="exact"><Dimension start="2"/></Float64>
</ModelVariables>
<ModelStructure><Output valueReference="6" dependencies="5 20 17 8" dependenciesKind="constant fixed dependent dependent"/>
<Output valueReference="16"/><Output valueReference="19" dependencies="18"/><Output valueReference="22" dependencies="11"/>
<ContinuousStateDerivative valueReference="11" dependencies="10 5"/><InitialUnknown valueReference="11"/>
<InitialUnknown valueReference="6" dependencies="5 20"/><InitialUnknown valueReference="16" dependencies=""/>
<EventIndicator valueReference="6"/></ModelStructure>
<Annotations><Annotation type="v"><v:deep><v:er/> mixed </v:deep></Annotation></Annotations>
</fmiModelDescription>"""


def inner(name: str) -> bytes:
    """Of one of this repository's FMUs."""
    with zipfile.ZipFile(FMUS / name.removesuffix("_fmi3") / f"{name}.fmu") as file:
        return file.read("modelDescription.xml")


def wrapped(xml: bytes | str, fmi: int, added: Added, capabilities: Capabilities = ALL) -> Description:
    text = xml.encode() if isinstance(xml, str) else xml
    outer = Outer(fmi, "outer", "Outer", "{new}", "test", ("wrapper.c", "network.c"), capabilities)
    return describe(text, added, outer)


def validated(description: Description | bytes | str, structure: bool = True) -> ModelDescription:
    """What fmpy reads, its schema, names and structure checked."""
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        xml = description.xml if isinstance(description, Description) else description
        archive.writestr("modelDescription.xml", xml)
        if isinstance(description, Description) and description.build:
            archive.writestr("sources/buildDescription.xml", description.build)
    file.seek(0)
    return read_model_description(file, validate_variable_names=structure, validate_model_structure=structure)


def by_name(model: ModelDescription) -> dict[str, ModelVariable]:
    return {variable.name: variable for variable in model.modelVariables}
