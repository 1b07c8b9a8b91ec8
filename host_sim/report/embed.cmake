# Turns a file into a C++ source that holds its bytes, whatever they are and however many:
#
#   include(host_sim/report/embed.cmake)
#   esmc_embed(<target> <file> <symbol>)
#
# compiles into <target> a definition of `const std::string_view esmc::host::<symbol>`. An array of character
# literals is used, because string literals are limited to 64 KiB by the standard and some compilers.
#
# In the file `/*ESMC_INCLUDE name*/` stands for a file beside it, in host_sim/web or in host_sim/report, or for uplot.js and uplot.css: uPlot
# as npm has put it into host_sim/report/node_modules, with its licence. Where it is missing those two are empty, and the page
# has to live without `uPlot`.

if(CMAKE_SCRIPT_MODE_FILE STREQUAL CMAKE_CURRENT_LIST_FILE)  # build time: cmake -D input= output= symbol= -P
  set(uplot "${CMAKE_CURRENT_LIST_DIR}/node_modules/uplot")
  get_filename_component(folder "${input}" DIRECTORY)
  file(READ "${input}" text)
  string(REGEX MATCHALL "/\\*ESMC_INCLUDE [^*]*\\*/" includes "${text}")
  foreach(include IN LISTS includes)
    string(REGEX REPLACE "/\\*ESMC_INCLUDE ([^*]*)\\*/" "\\1" name "${include}")
    set(part "")
    if(name MATCHES "^uplot\\.(js|css)$")
      if(EXISTS "${uplot}/LICENSE")
        file(READ "${uplot}/LICENSE" licence)
        file(GLOB code "${uplot}/dist/uPlot*.min.${CMAKE_MATCH_1}")
        file(READ "${code}" part)
        set(part "/*! uPlot\n${licence}\n*/\n${part}")
      endif()
    elseif(EXISTS "${folder}/${name}")
      file(READ "${folder}/${name}" part)
    elseif(EXISTS "${CMAKE_CURRENT_LIST_DIR}/../web/${name}")
      file(READ "${CMAKE_CURRENT_LIST_DIR}/../web/${name}" part)
    else()
      file(READ "${CMAKE_CURRENT_LIST_DIR}/${name}" part)
    endif()
    string(REPLACE "${include}" "${part}" text "${text}")
  endforeach()
  if(includes)
    set(input "${output}.html")
    file(WRITE "${input}" "${text}")
  endif()
  file(READ "${input}" bytes HEX)
  string(REGEX REPLACE "(................................)" "\\1\n" bytes "${bytes}")
  string(REGEX REPLACE "([0-9a-f][0-9a-f])" "'\\\\x\\1'," bytes "${bytes}")
  file(WRITE "${output}" "// Generated from ${input} by embed.cmake.
#include <string_view>

namespace esmc::host {
namespace {
constexpr char bytes[] = {
${bytes}};
}  // namespace

extern const std::string_view ${symbol};
constinit const std::string_view ${symbol}{bytes, sizeof bytes};
}  // namespace esmc::host
")
  return()
endif()

if(NOT EXISTS "${CMAKE_CURRENT_LIST_DIR}/node_modules/uplot/LICENSE")
  message(WARNING "uPlot is missing: reports of this build will have no plots. `host_sim/setup demo` fetches it.")
endif()

function(esmc_embed target input symbol)
  get_filename_component(input "${input}" ABSOLUTE)
  get_filename_component(folder "${input}" DIRECTORY)
  set(here "${CMAKE_CURRENT_FUNCTION_LIST_DIR}")
  set(output "${CMAKE_CURRENT_BINARY_DIR}/${symbol}.cpp")
  # What it may include, looked for again at every build.
  file(GLOB parts CONFIGURE_DEPENDS "${here}/*.js" "${here}/*.css" "${here}/../web/*.js" "${here}/../web/*.css" "${folder}/*.js" "${folder}/*.css"
       "${here}/node_modules/uplot/LICENSE" "${here}/node_modules/uplot/dist/*.min.*")
  add_custom_command(
    OUTPUT "${output}"
    COMMAND "${CMAKE_COMMAND}" "-Dinput=${input}" "-Doutput=${output}" "-Dsymbol=${symbol}" -P "${here}/embed.cmake"
    DEPENDS "${input}" "${here}/embed.cmake" ${parts}
    COMMENT "Embedding ${input}"
    VERBATIM)
  target_sources(${target} PRIVATE "${output}")
  set_source_files_properties("${output}" PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
endfunction()
