# Turns a file into a C++ source that holds its bytes, whatever they are and however many:
#
#   include(host_sim/report/embed.cmake)
#   esmc_embed(<target> <file> <symbol>)
#   esmc_embed_page(<target> <page> <symbol>)
#
# compiles into <target> a definition of `const std::string_view esmc::host::<symbol>`. An array of character
# literals is used, because string literals are limited to 64 KiB by the standard and some compilers.
#
# A page is an HTML file in which a line `/*ESMC_INCLUDE name*/` stands for a file beside it or in host_sim/report, or for
# uplot.js and uplot.css: uPlot as npm has put it into host_sim/report/node_modules, with its licence. Where it is missing
# those two are empty, and the page has to live without `uPlot`.

set(page_parts "${CMAKE_CURRENT_LIST_DIR}")
set(uplot "${CMAKE_CURRENT_LIST_DIR}/node_modules/uplot")

if(CMAKE_SCRIPT_MODE_FILE STREQUAL CMAKE_CURRENT_LIST_FILE)  # build time: cmake -D input= output= symbol= -P
  if(page)
    file(READ "${input}" text)
    string(REGEX MATCHALL "/\\*ESMC_INCLUDE [^*]*\\*/" includes "${text}")
    foreach(include IN LISTS includes)
      string(REGEX REPLACE "/\\*ESMC_INCLUDE ([^*]*)\\*/" "\\1" name "${include}")
      get_filename_component(folder "${input}" DIRECTORY)
      set(part "")
      if(name STREQUAL "uplot.js" OR name STREQUAL "uplot.css")
        if(EXISTS "${uplot}/LICENSE")
          file(READ "${uplot}/LICENSE" licence)
          file(READ "${uplot}/dist/uPlot.min.css" part)
          if(name STREQUAL "uplot.js")
            file(READ "${uplot}/dist/uPlot.iife.min.js" part)
          endif()
          set(part "/*! uPlot\n${licence}\n*/\n${part}")
        endif()
      elseif(EXISTS "${folder}/${name}")
        file(READ "${folder}/${name}" part)
      else()
        file(READ "${page_parts}/${name}" part)
      endif()
      string(REPLACE "${include}" "${part}" text "${text}")
    endforeach()
    file(WRITE "${output}.html" "${text}")
    set(input "${output}.html")
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

set(ESMC_EMBED_SCRIPT "${CMAKE_CURRENT_LIST_FILE}")
set(ESMC_PAGE_PARTS "${page_parts}")
file(GLOB ESMC_UPLOT CONFIGURE_DEPENDS "${uplot}/LICENSE" "${uplot}/dist/*.min.*")  # looked for again at every build
if(NOT ESMC_UPLOT)
  message(WARNING "uPlot is missing: reports of this build will have no plots. `host_sim/setup demo` fetches it.")
endif()

function(esmc_embed target input symbol)
  get_filename_component(input "${input}" ABSOLUTE)
  set(output "${CMAKE_CURRENT_BINARY_DIR}/${symbol}.cpp")
  add_custom_command(
    OUTPUT "${output}"
    COMMAND "${CMAKE_COMMAND}" "-Dinput=${input}" "-Doutput=${output}" "-Dsymbol=${symbol}" "-Dpage=${ARGN}" -P "${ESMC_EMBED_SCRIPT}"
    DEPENDS "${input}" "${ESMC_EMBED_SCRIPT}" ${ESMC_PAGE_DEPENDS}
    COMMENT "Embedding ${input}"
    VERBATIM)
  target_sources(${target} PRIVATE "${output}")
  set_source_files_properties("${output}" PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
endfunction()

function(esmc_embed_page target input symbol)
  get_filename_component(folder "${input}" DIRECTORY)
  file(GLOB ESMC_PAGE_DEPENDS CONFIGURE_DEPENDS "${ESMC_PAGE_PARTS}/*.js" "${ESMC_PAGE_PARTS}/*.css" "${folder}/*.js" "${folder}/*.css")
  list(APPEND ESMC_PAGE_DEPENDS ${ESMC_UPLOT})
  list(REMOVE_DUPLICATES ESMC_PAGE_DEPENDS)
  esmc_embed(${target} ${input} ${symbol} page)
endfunction()
